"""Distances on a graph of places."""

from __future__ import annotations

import tracemalloc

import pytest

from somrs.traffic.planning import graph as module
from tests.support.roadmaps import two_way


def test_a_large_building_does_not_fill_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Robots go to each of its places in turn, as they do in the course of weeks."""
    monkeypatch.setattr(module, "MOST_NUMBERS", 40_000)
    monkeypatch.setattr(module, "FEWEST_GOALS", 4)
    size = 2_000
    graph = two_way(size, *((place, place + 1) for place in range(size - 1)))
    graph.distances(0)
    tracemalloc.start()
    for goal in range(0, size, 10):
        assert graph.distances(goal)[goal + 1] == 1.0
    own_traces = tracemalloc.take_snapshot().filter_traces([tracemalloc.Filter(True, module.__file__)])  # other threads need memory, too
    tracemalloc.stop()
    assert 8 * 20_000 < sum(trace.size for trace in own_traces.traces) < 2 * 8 * 40_000, "of the 3.2 MB for all goals"

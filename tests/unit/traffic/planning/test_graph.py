"""Distances on a graph of places."""

from __future__ import annotations

import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.traffic.planning import graph as module
from somrs.traffic.planning.graph import FAR, Graph, PrivatePlace
from tests.support.examples import examples
from tests.support.roadmaps import graphs, two_way


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


@examples(60)
@given(st.data(), graphs(8))
def test_to_get_on_from_delayed_places_takes_longer(data: st.DataObject, public: Graph) -> None:
    places = st.integers(0, public.size - 1)
    slow, start, end = data.draw(st.sets(places)), data.draw(places), data.draw(places)
    graph = public.with_private([PrivatePlace(0, ((start, 2.0),), ()), PrivatePlace(1, ((end, 3.0),), ())])
    delayed = graph.delayed(slow, 5.0)
    for goal in range(graph.size):
        assert delayed.distances(goal).tolist() == pytest.approx(slowly(graph, goal, slow, 5.0))
    assert graph.distances(public.size).tolist() == pytest.approx(slowly(graph, public.size, set(), 0.0)), "it is as it was"


@examples(60)
@given(st.data(), graphs(8))
def test_distances_from_a_place_are_those_to_the_others(data: st.DataObject, public: Graph) -> None:
    places = st.integers(0, public.size - 1)
    lanes = tuple(data.draw(st.dictionaries(places, st.floats(0.1, 5.0), max_size=3)).items())
    graph = public.with_private([None, PrivatePlace(0, lanes, ())])
    for start in [*range(public.size), public.size + 1]:
        distances = [graph.distances(goal)[start] for goal in range(public.size)]
        assert graph.distances_from(start).tolist() == pytest.approx(distances)


def slowly(graph: Graph, goal: int, slow: set[int], seconds: float) -> list[float]:
    """The distances, step by step (Bellman and Ford). No way leads through a private place."""
    lengths = {
        (start, end): graph.length(start, end) + seconds * (start in slow)
        for start in range(graph.size)
        for end in [*graph.options(start, 0), *graph.options(start, 1)]
    }
    distances = [0.0 if place == goal else FAR for place in range(graph.size)]
    for _ in range(graph.size):
        for (start, end), length in lengths.items():
            if end < graph.public_size or end == goal:
                distances[start] = min(distances[start], distances[end] + length)
    return distances

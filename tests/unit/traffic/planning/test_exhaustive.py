"""A search among all configurations: it finds ways in the fewest moves, and proves that there are none."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.traffic.planning.exhaustive import search_all
from somrs.traffic.planning.graph import Graph
from somrs.traffic.planning.lacam import SearchLimit
from somrs.traffic.planning.pibt import Goals
from tests.support.examples import examples
from tests.support.roadmaps import configurations, graphs, grid, is_possible, shortest_course


@examples(150)
@given(st.data(), graphs(6))
def test_ways_are_found_if_there_are_any(data: st.DataObject, graph: Graph) -> None:
    """The plain twin moves any number of robots at once."""
    places = data.draw(configurations(graph, 3))
    goals: Goals = [data.draw(st.none() | st.integers(0, graph.size - 1)) for _ in places]
    ways = search_all(graph, places, goals, 10_000)
    assert (ways is None) == (shortest_course(graph, places, goals, rotations=False) is None)
    for before, after in pairwise(ways or []):
        assert is_possible(graph, before, after, rotations=False)
        assert sum(old != new for old, new in zip(before, after, strict=True)) == 1


def test_a_robot_that_cannot_move_is_gone_round() -> None:
    graph, at = grid("A.B", ".#.", "...")
    ways = search_all(graph, (at["A"], 1), (at["B"], None), 1_000, {1})
    assert ways is not None
    assert all(places[1] == 1 for places in ways)
    assert len(ways) - 1 == 6


def test_a_search_ends_at_its_limit() -> None:
    graph, at = grid("A...B")
    with pytest.raises(SearchLimit):
        search_all(graph, (at["A"],), (at["B"],), 3)

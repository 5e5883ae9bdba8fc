"""Ways for all robots: found wherever there are any."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.traffic.planning.graph import Graph
from somrs.traffic.planning.lacam import SearchLimit, find_ways
from somrs.traffic.planning.pibt import Goals, StepPlanner
from tests.support.examples import examples
from tests.support.roadmaps import configurations, graphs, grid, is_possible, shortest_course


@examples(150)
@given(st.data(), graphs(6), st.booleans())
def test_ways_are_found_if_there_are_any(data: st.DataObject, graph: Graph, rotations: bool) -> None:
    """The plain twin looks at all configurations."""
    places = data.draw(configurations(graph, 3))
    goals: Goals = [data.draw(st.none() | st.integers(0, graph.size - 1)) for _ in places]
    ways = find_ways(graph, places, goals, StepPlanner(graph, rotations=rotations))
    fewest = shortest_course(graph, places, goals, rotations=rotations)
    if ways is None:
        assert fewest is None
        return
    assert fewest is not None
    assert len(ways) - 1 >= fewest
    assert ways[0] == places
    assert all(goal is None or goal == place for goal, place in zip(goals, ways[-1], strict=True))
    assert all(is_possible(graph, before, after, rotations=rotations) for before, after in pairwise(ways))


def test_three_robots_turn_round_in_a_narrow_way() -> None:
    """One place to pass for three robots that have to change their order."""
    graph, at = grid("A.B.C.", "##D###")
    places = at["A"], at["B"], at["C"]
    ways = find_ways(graph, places, places[::-1], StepPlanner(graph))
    assert ways is not None
    assert ways[-1] == places[::-1]


def test_where_there_is_no_room_there_are_no_ways() -> None:
    graph, at = grid("A..B")
    assert find_ways(graph, (at["A"], at["B"]), (at["B"], at["A"]), StepPlanner(graph)) is None


def test_a_search_ends_at_its_limit() -> None:
    graph, at = grid("A..B")
    with pytest.raises(SearchLimit):
        find_ways(graph, (at["A"], at["B"]), (at["B"], at["A"]), StepPlanner(graph), most_steps=3)

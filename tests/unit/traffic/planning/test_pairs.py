"""Two robots that are alone: it is decided exactly whether one of them can get past the other."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.traffic.planning.graph import Graph, PrivatePlace
from somrs.traffic.planning.lacam import SearchLimit
from somrs.traffic.planning.pairs import search_pair
from tests.support.examples import examples
from tests.support.roadmaps import configurations, graphs, grid, is_possible, shortest_course

LIMIT = 10_000


@examples(150)
@given(st.data(), graphs(8), st.booleans(), st.booleans())
def test_ways_are_found_exactly_if_there_are_any(data: st.DataObject, graph: Graph, is_fixed: bool, has_few_moves: bool) -> None:
    """The plain twin moves both robots at once, and tries all that is possible."""
    places = data.draw(configurations(graph, 2).filter(lambda places: len(places) == 2))
    goal = data.draw(st.integers(0, graph.size - 1))
    ways = search_pair(graph, (places[0], places[1]), goal, (0, 1), LIMIT, fixed=is_fixed, fewest_moves=has_few_moves)
    reachable = graph.without([places[1]]) if is_fixed else graph
    start, goals = (places[:1], [goal]) if is_fixed else (places, [goal, None])
    assert (ways is None) == (shortest_course(reachable, start, goals, rotations=False) is None)
    if ways is not None:
        assert ways[0] == places
        assert ways[-1][0] == goal
    for pair, following in pairwise(ways or []):
        assert is_possible(graph, pair, following, rotations=False)


def test_the_other_one_stays_if_there_is_a_way_round_it() -> None:
    graph, named = grid("A.B.C", "#...#")
    ways = search_pair(graph, (named["A"], named["B"]), named["C"], (0, 1), LIMIT)
    assert ways is not None
    assert all(blocker == named["B"] for _, blocker in ways)


def test_the_other_one_goes_into_a_bay_and_no_farther() -> None:
    graph, named = grid("A..B.C", "##D###")
    ways = search_pair(graph, (named["A"], named["B"]), named["C"], (0, 1), LIMIT)
    assert ways is not None
    assert ways[-1] == (named["C"], named["D"])


def test_the_other_one_comes_out_of_its_own_berth_alone() -> None:
    public, named = grid("A.BC")
    graph = public.with_private([PrivatePlace("Other", ((named["B"], 1.0),), (named["B"],))])
    berth = public.size
    assert search_pair(graph, (named["A"], named["B"]), named["C"], ("Robot", "Other"), LIMIT) is None
    aside = public.with_private([PrivatePlace("Other", ((named["B"], 1.0),), ())])
    ways = search_pair(aside, (named["A"], named["B"]), named["C"], ("Robot", "Other"), LIMIT)
    assert ways is not None
    assert ways[-1] == (named["C"], berth)
    assert search_pair(aside, (named["A"], named["B"]), named["C"], ("Robot", "Third"), LIMIT) is None


def test_a_search_ends_at_its_limit() -> None:
    graph, named = grid("A......BC")
    with pytest.raises(SearchLimit):
        search_pair(graph, (named["A"], named["B"]), named["C"], (0, 1), 3)


def test_any_ways_are_found_after_few_pairs() -> None:
    """Whether one can get past another in a hall is asked for many robots, and for each plan."""
    graph, named = grid(*["." * 60] * 20, "." * 30 + "ABC" + "." * 27, *["." * 60] * 20)
    start, goal = (named["A"], named["B"]), named["C"]
    assert search_pair(graph, start, goal, (0, 1), 200, fewest_moves=False) is not None
    assert search_pair(graph, (named["A"], goal), goal, (0, 1), 200, fewest_moves=False) is not None
    with pytest.raises(SearchLimit):
        search_pair(graph, (named["A"], goal), goal, (0, 1), 200)

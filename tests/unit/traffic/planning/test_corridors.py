"""Corridors: where two robots cannot pass each other, the second one waits outside."""

from __future__ import annotations

from random import Random

import pytest

from somrs.traffic.planning.corridors import NOWHERE
from somrs.traffic.planning.graph import Graph, PrivatePlace
from somrs.traffic.planning.pibt import StepPlanner
from somrs.traffic.planning.window import Traveller, WindowPlanner
from tests.support.roadmaps import grid

TWO_ROOMS = ("ABC###DEF", "GHIJKLMNO", "PQR###STU")
"""Two rooms of nine places, and a corridor of three places between them."""


def test_a_corridor_is_a_chain_with_its_mouths() -> None:
    graph, at = grid(*TWO_ROOMS)
    corridor = {graph.corridors[at[name]] for name in "JKL"}
    assert len(corridor) == 1
    assert corridor != {NOWHERE}
    assert {graph.corridors[at[name]] for name in "IM"} == corridor, "the mouths"
    assert {graph.corridors[at[name]] for name in "HEFNBQ"} == {NOWHERE}


def test_a_bay_is_a_part_of_its_corridor_and_does_not_cut_it_in_two() -> None:
    for bays in (("ABC##x##DEF",), ("ABC##y##DEF", "R####x####S")):
        graph, at = grid(*bays[::-1], "GHIJKLMNOPQ", "TUV#####WXY")
        corridor = {graph.corridors[at[name]] for name in ("IJKLMNOx" if len(bays) == 1 else "JKLMNxy")}
        assert len(corridor) == 1
        assert corridor != {NOWHERE}


def test_places_side_by_side_and_short_narrow_ways_are_no_corridor() -> None:
    wide, _ = grid("......", "......", "......")
    assert set(wide.corridors) == {NOWHERE} or all(wide.corridors[place] == NOWHERE for place in (7, 8, 9, 10))
    door, at = grid("AB#CD", "EFGHI", "JK#LM")
    assert door.corridors[at["G"]] == NOWHERE


def test_places_that_exclude_each_other_do_not_make_a_corridor_wider() -> None:
    lanes = [(start, start + 1, 1.0) for start in range(5)] + [(2, 6, 1.0), (6, 3, 1.0)]
    both = [*lanes, *((end, start, length) for start, end, length in lanes)]
    assert len(set(Graph(7, both, [(6, 2), (6, 3)]).corridors[1:5])) == 1
    assert Graph(7, both, [(6, 2), (6, 3)]).corridors[2] != NOWHERE


def test_private_places_are_in_no_corridor() -> None:
    graph, at = grid(*TWO_ROOMS)
    with_berth = graph.with_private([PrivatePlace("Robot1", ((at["K"], 1.0),), ())])
    assert [*with_berth.corridors] == [*graph.corridors, NOWHERE]


@pytest.mark.parametrize("seed", range(5))
def test_a_robot_waits_outside_while_others_come_through(seed: int) -> None:
    """Two robots on each side want to the other one. Nobody drives back in the corridor."""
    graph, at = grid(*TWO_ROOMS)
    goals = (at["F"], at["U"], at["A"], at["P"])
    places: tuple[int, ...] = (at["H"], at["B"], at["N"], at["E"])
    planner = WindowPlanner(graph, Random(seed).shuffle)
    waiting, path = [0.0] * 4, [places]
    for _ in range(40):
        robots = [Traveller(place=place, goal=goal, waiting=waited) for place, goal, waited in zip(places, goals, waiting, strict=True)]
        places = planner.plan(robots, 1).steps[-1]
        path.append(places)
        waiting = [waited + 1 if place != goal else 0.0 for waited, place, goal in zip(waiting, places, goals, strict=True)]
        if places == goals:
            break
    assert places == goals
    inside = [at[name] for name in "JKL"]
    for robot in range(4):
        columns = [inside.index(configuration[robot]) for configuration in path if configuration[robot] in inside]
        assert columns in (sorted(columns), sorted(columns, reverse=True)), "it went back"
    assert len(path) < 22


@pytest.mark.parametrize(
    ("rows", "starts", "goals"),
    [
        (("AB###", "CDEFG"), "DA", "CD"),
        (("ABC####", "DEFGHIJ", "KLM####"), "EI", "JD"),
        (("ABCDEFG", "###H###", "###I###", "###J###"), "AG", "GA"),
    ],
    ids=["at a mouth", "in front of a mouth", "where three corridors meet"],
)
def test_nobody_waits_for_one_that_waits_for_it(rows: tuple[str, ...], starts: str, goals: str) -> None:
    """The one that waits before a corridor decides after those that come out, and who is in a corridor waits for nobody."""
    graph, at = grid(*rows)
    planner, waiting = StepPlanner(graph, shuffle=Random(0).shuffle), [0.0, 0.0]
    places: tuple[int, ...] = tuple(at[name] for name in starts)
    arrived: set[int] = set()
    for _ in range(40):
        following = planner.step(places, [graph.distances(at[name]) for name in goals], sorted((0, 1), key=lambda robot: -waiting[robot]))
        assert following is not None
        places = following
        arrived |= {robot for robot in (0, 1) if places[robot] == at[goals[robot]]}
        waiting = [0.0 if places[robot] == at[goals[robot]] else waiting[robot] + 1 for robot in (0, 1)]
    assert arrived == {0, 1}

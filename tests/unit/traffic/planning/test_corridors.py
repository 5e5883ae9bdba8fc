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


def test_one_that_waits_before_a_corridor_lets_those_pass_that_come_out() -> None:
    """It stands on their way, and goes before them wherever both want to the same place."""
    graph, at = grid("ABC####", "DEFGHIJ", "KLM####")
    planner, goals = StepPlanner(graph, shuffle=Random(0).shuffle), (at["J"], at["D"])
    places: tuple[int, ...] = (at["E"], at["I"])
    for _ in range(20):
        following = planner.step(places, [graph.distances(goal) for goal in goals], [0, 1])
        assert following is not None
        places = following
    assert places == goals

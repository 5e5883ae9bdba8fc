"""One step of all robots: it is possible, and the first in line gets to its goal."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.traffic.planning.graph import Graph
from somrs.traffic.planning.pibt import Configuration, StepPlanner
from tests.support.examples import examples
from tests.support.roadmaps import configurations, graphs, grid, is_possible, is_valid, two_way


@examples(300)
@given(st.data(), graphs(), st.booleans(), st.integers(0, 99))
def test_a_step_is_possible_whatever_robots_want(data: st.DataObject, graph: Graph, rotations: bool, seed: int) -> None:
    places = data.draw(configurations(graph, 5))
    goals = [data.draw(st.integers(0, graph.size - 1)) for _ in places]
    planner = StepPlanner(graph, rotations=rotations, shuffle=Random(seed).shuffle)
    order = data.draw(st.permutations(range(len(places))))
    estimates = [graph.distances(goal) for goal in goals]
    for _ in range(3):
        after = planner.step(places, estimates, order)
        assert after is not None
        assert is_possible(graph, places, after, rotations=rotations)
        places = after


@examples(300)
@given(st.data(), graphs(), st.booleans())
def test_fixed_moves_are_made_or_refused(data: st.DataObject, graph: Graph, rotations: bool) -> None:
    places = data.draw(configurations(graph, 4))
    fixed = [
        (robot, data.draw(st.sampled_from((*graph.successors[place], place))))
        for robot, place in enumerate(places)
        if data.draw(st.booleans())
    ]
    estimates = [graph.distances(place) for place in places]
    after = StepPlanner(graph, rotations=rotations).step(places, estimates, range(len(places)), fixed)
    if after is not None:
        assert is_possible(graph, places, after, rotations=rotations)
        assert all(after[robot] == place for robot, place in fixed)
    elif len(fixed) == len(places):
        assert not is_possible(graph, places, tuple(place for _, place in fixed), rotations=rotations)


def course(graph: Graph, places: Configuration, goals: Configuration, steps: int, *, rotations: bool = False) -> list[Configuration]:
    planner = StepPlanner(graph, rotations=rotations)
    waiting = [0.5 - robot / 100 for robot in range(len(places))]
    configurations_ = [places]
    for _ in range(steps):
        order = sorted(range(len(places)), key=lambda robot: -waiting[robot])
        after = planner.step(configurations_[-1], [graph.distances(goal) for goal in goals], order)
        assert after is not None
        configurations_.append(after)
        waiting = [waiting[robot] + 1 if after[robot] != goals[robot] else 0.5 - robot / 100 for robot in range(len(places))]
        if after == goals:
            break
    return configurations_


def test_a_robot_that_is_in_the_way_makes_room() -> None:
    graph, at = grid("A.B.C", "##D##")
    assert course(graph, (at["A"], at["B"]), (at["C"], at["B"]), 10)[-1] == (at["C"], at["B"])


@pytest.mark.parametrize("rotations", [True, False])
def test_two_robots_pass_each_other_where_there_is_room(rotations: bool) -> None:
    """The only place to pass is behind one of them."""
    graph, at = grid("A...B.C", "#####D#")
    configurations_ = course(graph, (at["A"], at["B"]), (at["C"], at["A"]), 20, rotations=rotations)
    assert configurations_[-1] == (at["C"], at["A"])


def test_robots_in_a_circle_move_on_only_if_they_may() -> None:
    ring = Graph(3, [(0, 1, 1.0), (1, 2, 1.0), (2, 0, 1.0)])
    assert course(ring, (0, 1, 2), (1, 2, 0), 1, rotations=True)[-1] == (1, 2, 0)
    assert course(ring, (0, 1, 2), (1, 2, 0), 1)[-1] == (0, 1, 2)


def test_places_that_exclude_each_other_are_not_taken_at_the_same_time() -> None:
    graph = two_way(4, (0, 1), (2, 3), conflicts=((1, 3),))
    configurations_ = course(graph, (0, 2), (1, 3), 5)
    assert all(is_valid(graph, configuration) for configuration in configurations_)
    assert configurations_[-1] == (1, 2)


def test_distances_follow_one_way_lanes_and_their_lengths() -> None:
    graph = Graph(4, [(0, 1, 2.0), (1, 2, 2.0), (0, 2, 5.0), (2, 0, 1.0)])
    assert list(graph.distances(2)) == [4.0, 2.0, 0.0, float("inf")]


def test_whoever_would_be_pulled_round_and_round_is_not_pulled() -> None:
    """From place 1, a lane leads into a ring of one-way lanes, out of which none leads: there, nobody can be passed."""
    ring = [(2, 3, 1.0), (3, 4, 1.0), (4, 2, 1.0)]
    graph = Graph(5, [(0, 1, 1.0), (1, 0, 1.0), (1, 2, 1.0), *ring])
    estimates = [graph.distances(0), graph.distances(1)]
    assert StepPlanner(graph).step((1, 0), estimates, (0, 1)) is not None

"""Robots that are late: they keep the order of the plan, and nobody waits for ever."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.errors import UsageError
from somrs.traffic.planning.graph import Graph
from somrs.traffic.planning.window import Traveller, WindowPlanner
from somrs.traffic.schedule import Schedule
from tests.support.examples import examples
from tests.support.roadmaps import configurations, graphs, is_valid, two_way


@examples(150)
@given(st.data(), graphs(8))
def test_robots_that_are_late_finish_the_plan_and_never_meet(data: st.DataObject, graph: Graph) -> None:
    """In any order of grants and progress; the plan is made anew now and then, from where the granted ways end."""
    places = data.draw(configurations(graph, 4))
    goals = [data.draw(st.integers(0, graph.size - 1)) for _ in places]
    names = [f"Robot{number}" for number in range(len(places))]
    schedule, planner = Schedule(graph), WindowPlanner(graph, Random(0).shuffle)
    for name, place in zip(names, places, strict=True):
        schedule.enter(name, place)
    dice = data.draw(st.randoms(use_true_random=False))

    def plan_anew() -> None:
        travellers = [Traveller(place=schedule.last(name), goal=goal) for name, goal in zip(names, goals, strict=True)]
        course = planner.plan(travellers, 5).steps
        schedule.plan({name: [configuration[robot] for configuration in course] for robot, name in enumerate(names)})

    plan_anew()
    for _ in range(60):
        if dice.random() < 0.1:
            plan_anew()
        _progress(schedule, dice.choice(names), dice.random() < 0.5)
        _assert_apart(schedule, graph, names)
    last = tuple(schedule.planned(name)[-1] if schedule.planned(name) else schedule.last(name) for name in names)
    for _ in range(200):
        progressed = {_progress(schedule, name, grants) for name in names for grants in (True, False)}
        if progressed == {False}:
            break
    assert tuple(schedule.last(name) for name in names) == last, "everybody came to the end of the plan"
    assert is_valid(graph, last)


def _progress(schedule: Schedule, name: str, grants: bool) -> bool:
    """The robot gets its next place, or moves on to the next one that it holds. Returns whether anything happened."""
    if grants:
        return schedule.grant(name) is not None
    held = schedule.held(name)
    if len(held) < 2:
        return False
    schedule.advance(name, 1)
    return True


def _assert_apart(schedule: Schedule, graph: Graph, names: list[str]) -> None:
    holders: dict[int, str] = {}
    for name in names:
        for place in schedule.held(name):
            for close in (place, *graph.exclusions[place]):
                assert holders.get(close, name) == name
        holders |= dict.fromkeys(schedule.held(name), name)


LINE = two_way(4, (0, 1), (1, 2), (2, 3))


def schedule_of(**places: int) -> Schedule:
    schedule = Schedule(LINE)
    for name, place in places.items():
        schedule.enter(name, place)
    return schedule


def test_the_second_waits_until_the_first_has_left() -> None:
    schedule = schedule_of(A=1, B=0)
    schedule.plan({"A": [1, 2, 3], "B": [0, 1, 2]})
    assert schedule.grant("B") is None
    assert list(schedule.obstacles("B")) == ["A"]
    assert schedule.grant("A") == 2
    assert schedule.grant("B") is None, "A has not left yet"
    schedule.advance("A", 1)
    assert schedule.held("A") == (2,)
    assert schedule.grant("B") == 1
    assert (schedule.held("B"), schedule.planned("B")) == ((0, 1), (2,))


def test_the_order_of_the_plan_holds_at_a_free_place() -> None:
    schedule = schedule_of(A=0, B=2)
    schedule.plan({"A": [0, 0, 0, 1], "B": [2, 1, 2, 3]})
    assert schedule.grant("A") is None, "B comes first"
    assert list(schedule.obstacles("A")) == ["B"]


def test_what_is_planned_can_be_planned_anew_and_what_is_granted_cannot() -> None:
    schedule = schedule_of(A=0)
    schedule.plan({"A": [0, 1, 2, 3]})
    schedule.grant("A")
    schedule.plan({"A": [1, 0]})
    assert (schedule.held("A"), schedule.planned("A")) == ((0, 1), (0,))
    assert schedule.grant("A") == 0
    schedule.advance("A", 1)
    assert schedule.held("A") == (1, 0)
    assert schedule.holder(0) == "A", "it holds the place for its way back"


def test_a_robot_that_leaves_frees_what_it_held() -> None:
    schedule = schedule_of(A=0, B=3)
    schedule.plan({"A": [0, 1], "B": [3, 2]})
    schedule.grant("A")
    schedule.leave("A")
    assert (schedule.holder(0), schedule.holder(1), schedule.holder(3)) == (None, None, "B")
    assert "A" not in schedule


def test_no_robot_appears_where_another_one_is() -> None:
    schedule = schedule_of(A=0)
    with pytest.raises(UsageError, match="A is too close"):
        schedule.enter("B", 0)
    with pytest.raises(UsageError, match="takes part already"):
        schedule.enter("A", 2)
    with pytest.raises(UsageError, match="no right"):
        schedule.advance("A", 1)

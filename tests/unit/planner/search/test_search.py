"""The search forward: which plan it takes, when it gives up, how far states are from the goal, and what a plan can do without."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.ontology.services import ServiceType
from somrs.planner.encodings.sas import decode_moves
from somrs.planner.grounding.task import Move, Task
from somrs.planner.search.progress import Progress, measure_progress
from somrs.planner.search.search import AdditiveHeuristic, TooHard, cheapest, remove_redundant_moves, search
from tests.unit.planner.grounding.test_grounding import (
    GO_SERVICE,
    PUT_SERVICE,
    TAKE_SERVICE,
    format_action,
    ground_problem,
    make_world,
    service,
)

MARK = service("Mark", None, "marked(?T)", T="Thing")
WASH = service("Wash", None, "?T likes P1", T="Thing")
LABEL = service("Label", "?T likes P1", "marked(?T)", T="Thing")
SOIL = service("Soil", "?T likes P1", "marked(?T) AND NOT ?T likes P1", T="Thing")
RINSE = service("Rinse", "?T likes P1", "?T.Clean = TRUE", T="Thing")
BURN = service("Burn", "marked(R1)", "?T.Clean = TRUE AND NOT marked(R1)", T="Thing")
WAY = "T1 on P1, R1 at P1, P2 near P1"


def costing(service: ServiceType, cost: int) -> ServiceType:
    return structs.replace(service, cost=str(cost))


def task_of(goal: str, *services: ServiceType, facts: str = "") -> Task:
    return Task(ground_problem(make_world(goal, *services, facts=facts)))


def format_moves(moves: list[Move] | None) -> list[str] | None:
    return [format_action(move.action) for move in moves] if moves is not None else None


def moves_of(task: Task, *names: str) -> list[Move]:
    by_name = {format_action(move.action): move for move in task.moves}
    return [by_name[name] for name in names]


@pytest.mark.parametrize(
    ("goal", "services", "facts", "expected"),
    [
        ("T1 on P1", (PUT_SERVICE,), "T1 on P1", []),
        ("marked(T1)", (MARK,), "", ["Mark T=T1"]),
        (
            "T1 on P2",
            (PUT_SERVICE, TAKE_SERVICE, GO_SERVICE),
            WAY,
            ["Take T=T1 Provider=R1 P=P1", "Go To=P2 Provider=R1 From=P1", "Put T=T1 P=P2 Provider=R1"],
        ),
        ("marked(T1) OR marked(T2) AND marked(C1)", (MARK,), "", ["Mark T=T1"]),
        ("T1.Clean = TRUE AND marked(T1)", (SOIL, RINSE), "T1 likes P1", ["Rinse T=T1", "Soil T=T1"]),
        ("T1.Clean = TRUE AND marked(T1)", (RINSE, SOIL), "T1 likes P1", ["Rinse T=T1", "Soil T=T1"]),
        ("T1.Clean = TRUE", (BURN,), "marked R1", ["Burn T=T1"]),
        ("T1.Clean = TRUE AND T2.Clean = TRUE", (BURN,), "marked R1", None),
    ],
)
def test_the_moves_that_reach_the_goal(goal: str, services: tuple[ServiceType, ...], facts: str, expected: list[str] | None) -> None:
    task = task_of(goal, *services, facts=facts)
    for moves in (search(task), search(task, cheap=True), cheapest(task)):
        assert format_moves(moves) == expected


@pytest.mark.parametrize(
    ("mark", "wash", "label", "first_plan", "cheap"),
    [
        (1, 1, 1, ["Mark T=T1"], ["Mark T=T1"]),
        (5, 1, 1, ["Mark T=T1"], ["Wash T=T1", "Label T=T1"]),
        (5, 4, 4, ["Mark T=T1"], ["Mark T=T1"]),
        (5, 5, 5, ["Mark T=T1"], ["Mark T=T1"]),
    ],
)
def test_a_cheaper_plan_is_taken_unless_there_is_a_hurry(mark: int, wash: int, label: int, first_plan: list[str], cheap: list[str]) -> None:
    task = task_of("marked(T1)", costing(MARK, mark), costing(WASH, wash), costing(LABEL, label))
    assert format_moves(search(task)) == first_plan
    assert format_moves(search(task, cheap=True)) == format_moves(cheapest(task)) == cheap
    task.hurry = True
    assert format_moves(cheapest(task)) == first_plan


@pytest.mark.parametrize(
    ("goal", "services", "required_effort"),
    [
        ("marked(T1)", (MARK,), 3),
        ("marked(T1)", (WASH, LABEL), 10),
        ("marked(T1) AND marked(T2)", (MARK,), 10),
        ("T1 on P2", (PUT_SERVICE, TAKE_SERVICE, GO_SERVICE), 71),
    ],
)
def test_a_search_ends_when_it_has_looked_at_so_much(goal: str, services: tuple[ServiceType, ...], required_effort: int) -> None:
    """The moves of each state that is left behind count, and what each estimate looks at."""
    task = task_of(goal, *services, facts=WAY)
    assert search(task, required_effort) is not None
    with pytest.raises(TooHard):
        search(task, required_effort - 1)


def test_where_a_cheaper_plan_takes_too_long_the_first_one_does() -> None:
    task = task_of("marked(T1)", costing(MARK, 5), costing(WASH, 1), costing(LABEL, 1))
    with pytest.raises(TooHard):
        search(task, 17, cheap=True)
    assert format_moves(cheapest(task, 17)) == ["Mark T=T1"]
    assert format_moves(cheapest(task, 18)) == ["Wash T=T1", "Label T=T1"]


@pytest.mark.parametrize(("longest", "searches"), [(None, 2), (4, 2), (3, 1), (2, 1)])
def test_a_plan_of_many_steps_is_not_searched_for_twice(longest: int | None, searches: int, monkeypatch: pytest.MonkeyPatch) -> None:
    task = task_of("T1 on P2", PUT_SERVICE, TAKE_SERVICE, GO_SERVICE, facts=WAY)
    efforts: list[int] = []

    def counted(task: Task, effort: int, *, cheap: bool = False) -> list[Move] | None:
        efforts.append(effort)
        return search(task, effort, cheap=cheap)

    monkeypatch.setattr("somrs.planner.search.search.search", counted)
    assert len(cheapest(task, 10_000, longest) or ()) == 3
    assert efforts == [10_000, 1_000][:searches]


def test_an_engines_plan_ends_where_it_reaches_the_goal() -> None:
    """An engine for parallel plans may add moves after that, which lead away from the goal."""
    task = task_of("marked(?T: Thing)", SOIL, WASH, facts=WAY)
    moves = ["Wash T=T1", "Soil T=T1"]
    numbers = {format_action(move.action): number for number, move in enumerate(task.moves)}
    goal = next(name for name in numbers if name.startswith("goal"))
    names = [f"{numbers[name]} of an engine" for name in (*moves, goal, "Wash T=T1")]
    assert format_moves(decode_moves(names, task)) == moves


def test_a_search_that_gave_up_says_how_far_it_got() -> None:
    task = task_of("marked(T1) AND marked(T2) AND marked(C1)", MARK)
    with pytest.raises(TooHard, match=r"^4 states were looked at; at best 1 of the goal's 3 parts held at once$") as raised:
        search(task, 0)
    assert raised.value.progress == Progress(states=4, held_count=1, parts=3)


@pytest.mark.parametrize(
    ("states", "held_count", "parts"),
    [
        ([[]], 0, 3),
        ([[], ["Mark T=T1"]], 1, 3),
        ([["Wash T=T1"], []], 1, 2),
        ([["Mark T=T1"], ["Wash T=T1"]], 1, 2),
        ([["Mark T=T1", "Mark T=T2"], ["Wash T=T1"]], 2, 3),
        ([["Mark T=T1", "Wash T=T1"], ["Wash T=T1", "Wash T=T2"]], 2, 2),
    ],
)
def test_how_far_states_are_from_the_nearest_alternative(states: list[list[str]], held_count: int, parts: int) -> None:
    task = task_of("marked(T1) AND marked(T2) AND marked(C1) OR T1 likes P1 AND T2 likes P1", MARK, WASH)
    visited_states = []
    for names in states:
        state = task.initial
        for move in moves_of(task, *names):
            state = move.apply(state)
        visited_states.append(state)
    assert measure_progress(task, visited_states) == Progress(states=len(states), held_count=held_count, parts=parts)


@pytest.mark.parametrize(
    ("goal", "services", "facts", "distance", "helpful"),
    [
        ("T1 on P1", (PUT_SERVICE,), "T1 on P1", 0.0, {"goal"}),
        ("marked(T1)", (MARK,), "", 1.0, {"Mark T=T1"}),
        ("marked(T1) AND marked(T2)", (MARK,), "", 2.0, {"Mark T=T1", "Mark T=T2"}),
        ("marked(T1) OR marked(T2) AND marked(C1)", (MARK,), "", 1.0, {"Mark T=T1"}),
        ("marked(T1)", (WASH, LABEL), "", 2.0, {"Wash T=T1"}),
        ("T1 on P2", (PUT_SERVICE, TAKE_SERVICE, GO_SERVICE), WAY, 3.0, {"Take T=T1 Provider=R1 P=P1", "Go To=P2 Provider=R1 From=P1"}),
        ("T1.Clean = TRUE AND T2.Clean = TRUE", (BURN,), "marked R1", 2.0, {"Burn T=T1", "Burn T=T2"}),
    ],
)
def test_how_far_the_goal_is_and_what_a_way_there_begins_with(
    goal: str, services: tuple[ServiceType, ...], facts: str, distance: float, helpful: set[str]
) -> None:
    task = task_of(goal, *services, facts=facts)
    estimate, moves = AdditiveHeuristic(task).evaluate(task.initial)
    assert (estimate, {format_action(move.action) for move in moves}) == (distance, helpful)


def test_a_state_from_which_nothing_leads_to_the_goal_has_no_distance() -> None:
    task = task_of("T1.Clean = TRUE AND T2.Clean = TRUE", BURN, facts="marked R1")
    (burn,) = moves_of(task, "Burn T=T1")
    assert AdditiveHeuristic(task).evaluate(burn.apply(task.initial)) == (None, set())


def test_the_cheapest_way_is_as_far_as_it_costs() -> None:
    task = task_of("marked(T1)", costing(MARK, 5), costing(WASH, 1), costing(LABEL, 3))
    assert [AdditiveHeuristic(task, cheap=cheap).evaluate(task.initial)[0] for cheap in (False, True)] == [1.0, 4.0]
    assert format_moves([*AdditiveHeuristic(task, cheap=True).evaluate(task.initial)[1]]) == ["Wash T=T1"]


@pytest.mark.parametrize(
    ("goal", "moves", "expected"),
    [
        ("marked(T1)", ["Mark T=T2", "Mark T=T1", "Mark T=C1"], ["Mark T=T1"]),
        ("marked(T1)", ["Mark T=T1", "Mark T=T1"], ["Mark T=T1"]),
        ("marked(T1) AND marked(T2)", ["Mark T=T1", "Mark T=T2"], ["Mark T=T1", "Mark T=T2"]),
        ("marked(T1)", ["Wash T=T1", "Label T=T1", "Mark T=T1"], ["Mark T=T1"]),
        ("marked(T1)", ["Wash T=T1", "Label T=T1", "Wash T=T2"], ["Wash T=T1", "Label T=T1"]),
        ("marked(T1) OR marked(T2)", ["Wash T=T1", "Label T=T1", "Mark T=T2"], ["Mark T=T2"]),
    ],
)
def test_what_a_plan_can_do_without_goes_with_what_only_that_makes_possible(goal: str, moves: list[str], expected: list[str]) -> None:
    task = task_of(f"({goal}) OR marked(C1) AND marked(T2) AND T2 likes P1", MARK, WASH, LABEL)
    assert format_moves(remove_redundant_moves(moves_of(task, *moves), task)) == expected

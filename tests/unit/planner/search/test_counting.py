"""States with numbers: what moves ask of counters and make of them, and the search that counts."""

from __future__ import annotations

import pytest

from somrs.entish import Number
from somrs.entish.parse import parse_term
from somrs.ontology.services import ServiceType
from somrs.planner.grounding.task import Move, Task
from somrs.planner.search.counting import Counters, CountingFailed, Numbers, reaches_goal, remove_redundant_moves, search_with_counters
from tests.unit.planner.grounding.test_grounding import format_action, ground_problem, make_world, service

Values = dict[str, dict[str, float | str | bool]]
FILL = service("Fill", None, "?T.Count = ?T.Count + 1", T="Thing")
MARK = service("Mark", None, "marked(?T)", T="Thing")


def counted(goal: str, *services: ServiceType, values: Values | None = None, facts: str = "") -> tuple[Task, Counters]:
    problem, world = make_world(goal, *services, facts=facts, values=values or {}, counting=True)
    task = Task(ground_problem((problem, world)))
    return task, Counters(task, world)


def move_of(task: Task, name: str) -> Move:
    return next(move for move in task.moves if format_action(move.action) == name)


def make_single_move(precondition: str | None, effect: str, values: Values) -> tuple[Counters, Move]:
    """The counters of a task with one service, and its use for T1; the numbers of others come first."""
    task, counters = counted("marked(T1)", service("Do", precondition, f"{effect}marked(?T)", T="Thing"), FILL, LIFT, LEVEL, values=values)
    return counters, move_of(task, "Do T=T1")


LIFT = service("Lift", None, "?T.Weight = ?T.Weight + 1 kg", T="Thing")
LEVEL = service("Raise", None, "?T.Level = ?T.Level + 1 m", T="Thing")


@pytest.mark.parametrize(
    ("condition", "values", "allowed", "gap"),
    [
        ("?T.Count >= 2", {"Count": 2.0}, True, 0.0),
        ("?T.Count > 2", {"Count": 2.0}, False, 1.0),
        ("?T.Count >= 2", {"Count": 1.0}, False, 1.5),
        ("?T.Count >= 2", {"Count": -1.0}, False, 1.75),
        ("2 <= ?T.Count", {"Count": 1.0}, False, 1.5),
        ("?T.Count <= 2", {"Count": 5.0}, False, 1.75),
        ("NOT ?T.Count >= 2", {"Count": 1.0}, True, 0.0),
        ("NOT ?T.Count >= 2", {"Count": 3.0}, False, 1.5),
        ("?T.Count >= 2", {}, False, 2.0),
        ("NOT ?T.Count >= 2", {}, True, 0.0),
        ("2 <= ?T.Count", {}, False, 2.0),
        ("?T.Count + 1 >= 3", {"Count": 2.0}, True, 0.0),
        ("?T.Count >= 2 AND ?T.Count >= 4", {"Count": 1.0}, False, 3.25),
        ("?T.Count >= 2 AND ?T.Count >= 4", {"Count": 3.0}, False, 1.5),
        ("?T.Count = ?T.Count", {"Count": 3.0}, True, 0.0),
        ("?T.Weight = 2 kg", {"Weight": 2.4}, True, 0.0),
        ("2 kg = ?T.Weight", {"Weight": 2.4}, True, 0.0),
        ("?T.Weight = 2 kg", {"Weight": 3.0}, False, 1.5),
        ("?T.Weight >= 2000 g", {"Weight": 3.0}, True, 0.0),
        ("?T.Level = 2 m", {"Level": 2.4}, False, 2.0 - 1 / 1.4),
        ("?T.Count > 1 kg", {"Count": 3.0}, True, 0.0),
        ("?T.Level > 1 kg", {"Level": 3.0}, False, 2.0),
    ],
)
def test_what_a_move_asks_of_counters(condition: str, values: dict[str, float | str | bool], allowed: bool, gap: float) -> None:
    counters, move = make_single_move(condition, "", {"T1": values})
    for _ in range(2):
        assert counters.allows(move, counters.initial) is allowed
    assert counters.gap(move, counters.initial) == pytest.approx(gap)


def test_the_numbers_that_are_given_count_and_not_those_of_the_beginning() -> None:
    counters, move = make_single_move("?T.Count >= 2", "", {"T1": {"Count": 1.0}})
    place = counters.names.index("T1.Count")

    def with_number(value: float | None) -> Numbers:
        return tuple(value if number == place else old for number, old in enumerate(counters.initial))

    assert [counters.allows(move, with_number(value)) for value in (1.0, 2.0, None, 3.0, 1.0)] == [False, True, False, True, False]
    assert [counters.gap(move, with_number(value)) for value in (1.0, 2.0, None)] == [1.5, 0.0, 2.0]


@pytest.mark.parametrize(
    ("effect", "values", "expected_numbers"),
    [
        ("?T.Count = ?T.Count + 2", {"Count": 1.0}, {"T1.Count": 3.0}),
        ("?T.Count = ?T.Count - 2", {"Count": 1.0}, {"T1.Count": -1.0}),
        ("?T.Count = 7", {}, {"T1.Count": 7.0}),
        ("?T.Count = ?T.Count + 2", {}, None),
        ("?T.Count = T1", {}, None),
        ("?T.Level = 200 cm", {"Level": 1.0}, {"T1.Level": 2.0}),
        ("?T.Level = 2", {"Level": 1.0}, {"T1.Level": 2.0}),
        ("?T.Level = 2 kg", {"Level": 1.0}, None),
        ("?T.Level = 5 m", {"Level": 1.0}, {"T1.Level": 5.0}),
        ("?T.Level = 5.5 m", {"Level": 1.0}, None),
        ("?T.Level = ?T.Level - 1 m", {"Level": 1.0}, {"T1.Level": 0.0}),
        ("?T.Level = ?T.Level - 2 m", {"Level": 1.0}, None),
        ("?T.Count = 3 m", {"Count": 1.0}, {"T1.Count": 3.0}),
        ("?T.Count = ?T.Count + 1 AND ?T.Level = 1 m", {"Count": 1.0}, {"T1.Count": 2.0, "T1.Level": 1.0}),
        ("?T.Count = ?T.Count + 1 AND ?T.Level = 9 m", {"Count": 1.0}, None),
        ("?T.Count = ?T.Weight AND ?T.Weight = ?T.Count", {"Count": 1.0, "Weight": 2.0}, {"T1.Count": 2.0, "T1.Weight": 1.0}),
    ],
)
def test_what_a_move_makes_of_counters(
    effect: str, values: dict[str, float | str | bool], expected_numbers: dict[str, float] | None
) -> None:
    counters, move = make_single_move(None, f"{effect} AND ", {"T1": values})
    numbers_before = dict(zip(counters.names, counters.initial, strict=True))
    numbers_after = counters.apply(move, counters.initial)
    if expected_numbers is None:
        assert numbers_after is None
    else:
        assert numbers_after is not None
        assert dict(zip(counters.names, numbers_after, strict=True)) == {**numbers_before, **expected_numbers}


def test_a_move_that_sets_no_counter_leaves_them_as_they_are() -> None:
    counters, move = make_single_move(None, "", {"T1": {"Count": 1.0}})
    assert counters.apply(move, (7.0, 8.0)) == (7.0, 8.0)


def test_the_counters_of_a_task() -> None:
    task, counters = counted("T1.Count >= 2 AND T2.Level >= 1 m", FILL, LEVEL, values={"T1": {"Count": 1.0}})
    assert len(task.moves) > 2
    initial_numbers = {name: (counters.initial[place], counters.unit(place)) for place, name in enumerate(counters.names)}
    assert initial_numbers["T1.Count"] == (1.0, None)
    assert initial_numbers["T2.Level"] == (None, "m")
    assert len(initial_numbers) == len(counters.names) == len(counters.attributes)
    assert counters.measure_term(parse_term("3 m")) == Number(3.0, "m")
    assert counters.measure_term(parse_term("T1.Count")) == Number(1.0)
    assert counters.measure_term(parse_term("T2.Count")) is None
    assert counters.measure_term(parse_term("TRUE")) is None


# The search

CLOSE = service("Close", "?T.Count >= 2", "marked(?T)", T="Thing")
USE = service("Use", "?T.Count >= 1", "?T.Count = ?T.Count - 1 AND ?T.Clean = TRUE", T="Thing")


def find_actions(task: Task, counters: Counters, states: int = 1000) -> list[str] | None:
    moves = search_with_counters(task, counters, states)
    return [format_action(move.action) for move in moves] if moves is not None else None


@pytest.mark.parametrize(
    ("goal", "services", "values", "expected"),
    [
        ("T1.Count >= 2", (FILL,), {"T1": {"Count": 0.0}}, ["Fill T=T1"] * 2),
        ("T1.Count >= 2", (FILL,), {"T1": {"Count": 2.0}}, []),
        ("marked(T1)", (FILL, CLOSE), {"T1": {"Count": 0.0}}, ["Fill T=T1", "Fill T=T1", "Close T=T1"]),
        ("marked(T1)", (FILL, CLOSE, MARK), {"T1": {"Count": 0.0}}, ["Mark T=T1"]),
        ("T1.Level >= 6 m", (LEVEL,), {"T1": {"Level": 0.0}}, None),
        ("T1.Level >= 5 m", (LEVEL,), {"T1": {"Level": 3.0}}, ["Raise T=T1"] * 2),
    ],
)
def test_plans_that_count(goal: str, services: tuple[ServiceType, ...], values: Values, expected: list[str] | None) -> None:
    task, counters = counted(goal, *services, values=values)
    assert find_actions(task, counters) == expected


def test_what_a_step_uses_up_is_made_up_for() -> None:
    task, counters = counted("T1.Clean = TRUE AND T1.Count >= 1", FILL, USE, values={"T1": {"Count": 1.0}})
    moves = search_with_counters(task, counters, 1000)
    assert moves is not None
    assert sorted(format_action(move.action) for move in moves) == ["Fill T=T1", "Use T=T1"]
    assert reaches_goal(moves, task, counters)


def test_so_many_states_are_looked_at_and_no_more() -> None:
    task, counters = counted("T1.Count >= 4", FILL, values={"T1": {"Count": 0.0}})
    with pytest.raises(CountingFailed, match="3 states were looked at"):
        search_with_counters(task, counters, 2)
    assert find_actions(task, counters, 5) == ["Fill T=T1"] * 4
    with pytest.raises(CountingFailed, match="5 states were looked at"):
        search_with_counters(task, counters, 4)


@pytest.mark.parametrize(
    ("goal", "states", "steps"),
    [
        ("T1.Count = 3 AND T2.Count = 3 AND C1.Count = 3", 30, 9),
        ("marked(T1) AND marked(T2)", 25, 10),
        ("marked(T1) AND marked(T2) AND marked(C1)", 55, 15),
    ],
)
def test_numbers_that_are_asked_for_and_those_that_lead_there_are_gone_for(goal: str, states: int, steps: int) -> None:
    close = service("Close", "?T.Count >= 4", "marked(?T)", T="Thing")
    task, counters = counted(goal, FILL, close, values={name: {"Count": 0.0} for name in ("T1", "T2", "C1")})
    moves = search_with_counters(task, counters, states)
    assert moves is not None
    assert len(moves) == steps


def test_moves_that_a_plan_can_do_without_are_left_out() -> None:
    task, counters = counted("T1.Count >= 2 AND marked(T1)", FILL, CLOSE, values={"T1": {"Count": 0.0}})
    fill, close = move_of(task, "Fill T=T1"), move_of(task, "Close T=T1")
    assert remove_redundant_moves([fill, fill, close, fill, close], task, counters) == [fill, fill, close]
    assert remove_redundant_moves([fill, fill, close], task, counters) == [fill, fill, close]


def test_whether_moves_can_be_done_and_lead_to_the_goal() -> None:
    task, counters = counted(
        "T1.Level >= 5 m AND marked(T1)", LEVEL, service("Mark", "?T.Level >= 5 m", "marked(?T)", T="Thing"), values={"T1": {"Level": 4.0}}
    )
    lift, mark = move_of(task, "Raise T=T1"), move_of(task, "Mark T=T1")
    assert reaches_goal([lift, mark], task, counters)
    assert not reaches_goal([mark, lift], task, counters)
    assert not reaches_goal([lift], task, counters)
    assert not reaches_goal([lift, lift, mark], task, counters)
    assert not reaches_goal([lift, mark, lift], task, counters)


def test_a_move_needs_what_is_so() -> None:
    task, counters = counted(
        "T1.Clean = TRUE", MARK, service("Wash", "marked(?T)", "?T.Clean = TRUE AND ?T.Count = 1", T="Thing"), values={}
    )
    mark, wash = move_of(task, "Mark T=T1"), move_of(task, "Wash T=T1")
    assert [reaches_goal(moves, task, counters) for moves in ([mark, wash], [wash], [wash, mark], [])] == [True, False, False, False]
    assert find_actions(task, counters) == ["Mark T=T1", "Wash T=T1"]

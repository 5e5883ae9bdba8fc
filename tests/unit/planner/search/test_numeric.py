"""Tasks with counters as numeric PDDL, and the moves that an engine names."""

from __future__ import annotations

import pytest

from somrs.planner.grounding.task import Task
from somrs.planner.model.vocabulary import Inexpressible
from somrs.planner.search.counting import Counters
from somrs.planner.search.numeric import NumericTask
from tests.unit.planner.grounding.test_grounding import format_action, service
from tests.unit.planner.search.test_counting import FILL, LEVEL, LIFT, Values, counted

VALUES: Values = {"T1": {"Count": 2.5, "Weight": 3.0, "Level": 1.5}}
EFFECT_PREFIX = "(and (v0-1) (not (v0-0))"


def make_numeric_task(precondition: str | None, effect: str) -> tuple[Task, Counters, NumericTask]:
    task, counters = counted("marked(T1)", service("Do", precondition, effect, T="Thing"), FILL, LIFT, LEVEL, values=VALUES)
    return task, counters, NumericTask(task, counters)


def action(precondition: str | None, effect: str = "marked(?T)") -> tuple[str, str]:
    """What the service's use for T1 needs and makes of numbers, these by their names."""
    task, counters, written = make_numeric_task(precondition, effect)
    number = next(n for n, move in enumerate(task.moves) if format_action(move.action) == "Do T=T1")
    preconditions, _, effects = written.domain.partition(f"(:action a{number} :parameters () :precondition ")[2].partition("\n  :effect ")
    effects = effects.partition("\n")[0]
    for place, name in enumerate(counters.names):
        preconditions, effects = preconditions.replace(f"(n{place})", name), effects.replace(f"(n{place})", name)
    return preconditions.removeprefix("(and ").removesuffix(")"), effects.removeprefix(EFFECT_PREFIX).removesuffix("))").strip()


DOMAIN = """\
(define (domain d) (:requirements :strips :numeric-fluents :conditional-effects)
(:predicates (reached) (v0-0) (v0-1) (v1-0) (v1-1))
(:functions (n0) (n1))
(:action a0 :parameters () :precondition (and (>= (n0) (- 2 0.000000001)) (>= (n1) (- 1 0.500000001)))
  :effect (and (v0-1) (not (v0-0))))
(:action a1 :parameters () :precondition (and )
  :effect (and (assign (n0) (+ (n0) 1))))
(:action a2 :parameters () :precondition (and )
  :effect (and (assign (n1) (+ (n1) 1))))
(:action a3 :parameters () :precondition (and (v0-1))
  :effect (and (reached))))
"""
PROBLEM = """\
(define (problem p) (:domain d)
(:init (v0-0) (v1-0) (= (n0) 2.5) (= (n1) 0))
(:goal (reached)))
"""


def test_the_whole_task_is_written() -> None:
    do_service = service("Do", "?T.Count >= 2 AND T2.Weight >= 1 kg", "marked(?T)", T="Thing")
    task, counters = counted("marked(T1)", do_service, FILL, LIFT, values=VALUES)
    written = NumericTask(task, counters)
    assert [format_action(move.action) for move in task.moves] == ["Do T=T1", "Fill T=T1", "Lift T=T2", "goal"]
    assert (counters.names, counters.initial) == (["T1.Count", "T2.Weight"], (2.5, None))
    assert written.domain == DOMAIN
    assert written.problem == PROBLEM
    assert [format_action(move.action) for move in written.decode_moves(["a1", "A0", "a2", "a3", "a1"])] == [
        "Fill T=T1",
        "Do T=T1",
        "Lift T=T2",
    ]


@pytest.mark.parametrize(
    ("condition", "preconditions"),
    [
        ("?T.Count >= 2", "(>= T1.Count (- 2 0.000000001))"),
        ("?T.Count > 2", "(> T1.Count (+ 2 0.000000001))"),
        ("?T.Count <= 2", "(<= T1.Count (+ 2 0.000000001))"),
        ("?T.Count < 2", "(< T1.Count (- 2 0.000000001))"),
        ("?T.Count = 2", "(>= T1.Count (- 2 0.000000001)) (<= T1.Count (+ 2 0.000000001))"),
        ("NOT ?T.Count >= 2", "(< T1.Count (- 2 0.000000001))"),
        ("NOT ?T.Count > 2", "(<= T1.Count (+ 2 0.000000001))"),
        ("NOT ?T.Count <= 2", "(> T1.Count (+ 2 0.000000001))"),
        ("NOT ?T.Count < 2", "(>= T1.Count (- 2 0.000000001))"),
        ("NOT ?T.Count != 2", "(>= T1.Count (- 2 0.000000001)) (<= T1.Count (+ 2 0.000000001))"),
        ("?T.Weight >= 2000 g", "(>= T1.Weight (- 2 0.500000001))"),
        ("2 kg <= ?T.Weight", "(<= 2 (+ T1.Weight 0.500000001))"),
        ("?T.Weight >= 2", "(>= T1.Weight (- 2 0.500000001))"),
        ("?T.Count >= 100", "(>= T1.Count (- 100 0.000000001))"),
        ("?T.Level >= 50 cm", "(>= T1.Level (- 0.5 0.000000001))"),
        ("?T.Weight >= ?T.Count", "(>= T1.Weight (- T1.Count 0.500000001))"),
        ("?T.Count >= ?T.Weight", "(>= T1.Count (- T1.Weight 0.000000001))"),
        ("?T.Count + ?T.Count >= 1", "(>= (+ T1.Count T1.Count) (- 1 0.000000001))"),
        ("?T.Count * 2 >= 1", "(>= (* 2 T1.Count) (- 1 0.000000001))"),
        ("2 * 3 * ?T.Count >= 1", "(>= (* 6 T1.Count) (- 1 0.000000001))"),
        ("?T.Count >= 2 * 3", "(>= T1.Count (- 6 0.000000001))"),
        ("?T.Level >= 2 * 30 cm", "(>= T1.Level (- 0.6 0.000000001))"),
        ("?T.Count - 1 >= 2 AND ?T.Level >= 1 m", "(>= (- T1.Count 1) (- 2 0.000000001)) (>= T1.Level (- 1 0.000000001))"),
    ],
)
def test_what_is_asked_of_numbers(condition: str, preconditions: str) -> None:
    assert action(condition) == (preconditions, "")


@pytest.mark.parametrize(
    ("effect", "preconditions", "effects"),
    [
        ("?T.Count = ?T.Count + 2", "", "(assign T1.Count (+ T1.Count 2))"),
        ("?T.Count = 7", "", "(assign T1.Count 7)"),
        ("?T.Level = 200 cm", "", "(assign T1.Level 2)"),
        ("?T.Level = ?T.Level - 10 cm", "(>= (- T1.Level 0.1) 0) (<= (- T1.Level 0.1) 5)", "(assign T1.Level (- T1.Level 0.1))"),
        ("?T.Level = ?T.Count AND ?T.Count = 7", "(>= T1.Count 0) (<= T1.Count 5)", "(assign T1.Level T1.Count) (assign T1.Count 7)"),
    ],
)
def test_what_is_made_of_numbers(effect: str, preconditions: str, effects: str) -> None:
    assert action(None, f"{effect} AND marked(?T)") == (preconditions, effects)


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        ("?T.Count != 2", "?T1.Count != 2: an engine does not support that two numbers differ"),
        ("NOT ?T.Count = 2", "NOT ?T1.Count = 2: an engine does not support that two numbers differ"),
        ("?T.Level >= 1 kg", "1 kg: kg and m do not measure the same thing"),
        ("?T.Level >= ?T.Weight", "?T1.Weight: kg and m differ by more than a factor"),
        (
            "?T.Count * ?T.Count >= 1",
            "?T1.Count * ?T1.Count: an engine does not multiply two numbers that change, or with units",
        ),
        ("?T.Level * 2 m >= 1", "?T1.Level * 2 m: an engine does not multiply two numbers that change, or with units"),
        ("?T.Count >= T2", "T2: it is no number"),
        ("?T.Count >= T2.Mode", "T2.Mode: it has no value"),
    ],
)
def test_what_an_engine_does_not_take(condition: str, message: str) -> None:
    with pytest.raises(Inexpressible) as raised:
        action(condition)
    assert str(raised.value) == message


def test_a_variable_loses_the_values_that_it_may_have() -> None:
    put_service = service("Put", None, "?T on ?P AND ?T.Count = 1", T="Thing", P="Place")
    shift = service("Shift", "?T on P1", "?T on P2", T="Thing")
    drop = service("Drop", None, "NOT ?T on P1 AND marked(?T)", T="Thing")
    task, counters = counted("T1 on P2 AND T1.Count = 1 AND marked(T1) AND NOT T1 on P1", put_service, shift, drop, facts="T1 on P1")
    assert task.values[0] == [None, ("on", ("T1", "P1")), ("on", ("T1", "P2"))]
    actions = NumericTask(task, counters).domain.split("(:action ")[1:]
    effects = {
        format_action(move.action): action.split(":effect ")[1].split("\n")[0] for move, action in zip(task.moves, actions, strict=True)
    }
    assert effects == {
        "Drop T=T1": "(and (when (and (v0-1)) (and (v0-0) (not (v0-1)))) (v3-1) (not (v3-0)) (v1-1) (not (v1-0))))",
        "Put T=T1 P=P1": "(and (v0-1) (not (v0-0)) (not (v0-2)) (v3-0) (not (v3-1)) (assign (n0) 1)))",
        "Put T=T1 P=P2": "(and (v0-2) (not (v0-0)) (not (v0-1)) (v3-1) (not (v3-0)) (assign (n0) 1)))",
        "Shift T=T1": "(and (v0-2) (not (v0-1)) (v3-1) (not (v3-0))))",
        "goal": "(and (reached))))",
    }

"""The ground problem in variables: what begins, what moves need and make, and what things give up."""

from __future__ import annotations

import pytest

from somrs.ontology.services import ServiceType
from somrs.planner.grounding.finite_task import Assignment
from somrs.planner.grounding.task import Move, Task
from tests.unit.planner.grounding.test_grounding import (
    GO_SERVICE,
    PUT_SERVICE,
    TAKE_SERVICE,
    format_action,
    format_fact,
    ground_problem,
    make_world,
    service,
)


def make_task(goal: str, *services: ServiceType, facts: str = "", counting: bool = False) -> Task:
    return Task(ground_problem(make_world(goal, *services, facts=facts, counting=counting)))


def format_assignment(task: Task, assignment: Assignment) -> str:
    """As in `on(T1, P1)`; that none of a variable's facts holds as `no on(T1, P1) on(T1, P2)`."""
    values = task.values[assignment[0]]
    if (held := values[assignment[1]]) is not None:
        return format_fact(held)
    return " ".join(["no", *(format_fact(value) for value in values[1:] if value is not None)])


def format_move(task: Task, move: Move) -> str:
    """What the move needs, and what it makes, as in `a AND b -> c IF a AND d`."""
    effect_texts = [
        format_assignment(task, (variable, value)) + "".join(f" IF {format_assignment(task, condition)}" for condition in conditions)
        for conditions, variable, value in move.effects
    ]
    preconditions = " AND ".join(format_assignment(task, precondition) for precondition in move.preconditions)
    return f"{preconditions} -> {' AND '.join(sorted(effect_texts))}".strip()


def format_moves(task: Task) -> dict[str, str]:
    return {format_action(move.action).partition(" T1.")[0]: format_move(task, move) for move in task.moves}


def format_initial(task: Task) -> list[str]:
    return [format_assignment(task, place) for place in enumerate(task.initial)]


def things(name: str, precondition: str | None, effect: str) -> ServiceType:
    return service(name, precondition, effect, T="Thing")


def placing(name: str, precondition: str | None, effect: str) -> ServiceType:
    return service(name, precondition, effect, T="Thing", P="Place")


MARRY = service("Marry", None, "?A marriedTo ?B", A="Thing", B="Thing")
GLUE = placing("Glue", None, "?T gluedTo ?P")
TIE = placing("Tie", None, "?T tiedTo ?P")
FREE_PUT = placing("Put", None, "?T on ?P")


@pytest.mark.parametrize(
    ("goal", "services", "facts", "first", "expected"),
    [
        (
            "T1 on P2",
            (
                PUT_SERVICE,
                TAKE_SERVICE,
                GO_SERVICE,
            ),
            "T1 on P1, R1 at P1, P2 near P1",
            ["at(R1, P1)", "on(T1, P1)", "no ()"],
            {
                "Go To=P2 Provider=R1 From=P1": "at(R1, P1) -> at(R1, P2)",
                "Take T=T1 Provider=R1 P=P1": "on(T1, P1) AND at(R1, P1) -> heldBy(T1, R1)",
                "Put T=T1 P=P1 Provider=R1": "heldBy(T1, R1) AND at(R1, P1) -> on(T1, P1)",
                "Go To=P1 Provider=R1 From=P2": "at(R1, P2) -> at(R1, P1)",
                "Put T=T1 P=P2 Provider=R1": "heldBy(T1, R1) AND at(R1, P2) -> on(T1, P2)",
                "goal": "on(T1, P2) -> ()",
                "Take T=T1 Provider=R1 P=P2": "on(T1, P2) AND at(R1, P2) -> heldBy(T1, R1)",
            },
        ),
        (
            "NOT T1 on P1",
            (FREE_PUT,),
            "T1 on P1",
            ["on(T1, P1)", "no ()"],
            {"goal": "no on(T1, P1) -> ()", "Put T=T1 P=P1": "-> on(T1, P1)", "Put T=T1 P=P2": "-> no on(T1, P1)"},
        ),
        (
            "NOT T1 on P1 AND marked(T1)",
            (placing("Drop", "?T on ?Q", "NOT ?T on ?P AND marked(?T)"),),
            "T1 on P1",
            ["on *(T1)", "on(T1, P1)", "no marked(T1)", "no ()"],
            {
                "Drop T=T1 P=P1": "on *(T1) -> marked(T1) AND no on *(T1) IF on(T1, P1) AND no on(T1, P1) IF on(T1, P1)",
                "Drop T=T1 P=P2": "on *(T1) -> marked(T1)",
                "goal": "marked(T1) AND no on(T1, P1) -> ()",
            },
        ),
        (
            "marked(T1)",
            (things("Mark", "?T on ?Q", "marked(?T) AND NOT ?T on P1"),),
            "T1 on P1",
            ["on *(T1)", "on(T1, P1)", "no marked(T1)", "no ()"],
            {
                "Mark T=T1": "on *(T1) -> marked(T1) AND no on *(T1) IF on(T1, P1) AND no on(T1, P1) IF on(T1, P1)",
                "goal": "marked(T1) -> ()",
            },
        ),
        (
            "T1 near P1",
            (placing("Join", "NOT ?T near ?P", "?T near ?P"),),
            "",
            ["no near(P1, T1)", "no ()"],
            {"Join T=T1 P=P1": "no near(P1, T1) -> near(P1, T1)", "goal": "near(P1, T1) -> ()"},
        ),
        (
            "T1 near P1 AND NOT T1 near P2",
            (
                placing("Join", None, "?T near ?P"),
                placing("Part", None, "NOT ?T near ?P"),
            ),
            "P2 near T1",
            ["near(P2, T1)", "no near(P1, T1)", "no ()"],
            {"Join T=T1 P=P1": "-> near(P1, T1)", "Part T=T1 P=P2": "-> no near(P2, T1)", "goal": "near(P1, T1) AND no near(P2, T1) -> ()"},
        ),
        (
            "T1 follows P1 AND NOT T1 follows P2",
            (placing("Join", None, "?T follows ?P"),),
            "T1 follows P2, T1 follows R1",
            ["follows(T1, P2)", "no ()", "no NOT(('follows', ('T1', 'P2')))"],
            {
                "Join T=T1 P=P1": "-> NOT(('follows', ('T1', 'P2'))) AND follows(T1, P1)",
                "Join T=T1 P=P2": "-> follows(T1, P2) AND no NOT(('follows', ('T1', 'P2')))",
                "goal": "follows(T1, P1) AND NOT(('follows', ('T1', 'P2'))) -> ()",
            },
        ),
        (
            "T1 on P2 AND NOT T1 heldBy R1",
            (FREE_PUT,),
            "T1 heldBy R1, T1 on P1",
            ["heldBy(T1, R1)", "no ()", "no NOT(('heldBy', ('T1', 'R1')))"],
            {
                "Put T=T1 P=P1": "-> NOT(('heldBy', ('T1', 'R1'))) AND no heldBy(T1, R1) on(T1, P2)",
                "Put T=T1 P=P2": "-> NOT(('heldBy', ('T1', 'R1'))) AND on(T1, P2)",
                "goal": "on(T1, P2) AND NOT(('heldBy', ('T1', 'R1'))) -> ()",
            },
        ),
        (
            "T1.Mode = Fast AND NOT T1.Mode = Slow",
            (
                things("Fast", None, "?T.Mode = Fast"),
                things("Slow", None, "?T.Mode = Slow"),
            ),
            "",
            ["no .Mode(T1, Fast)", "no ()"],
            {"Fast T=T1": "-> .Mode(T1, Fast)", "goal": ".Mode(T1, Fast) -> ()"},
        ),
        (
            "T1 tiedTo P1 AND NOT T1 tiedTo P2",
            (TIE,),
            "T1 tiedTo P2",
            ["tiedTo(T1, P2)", "no tiedTo(T1, P1)", "no ()"],
            {"Tie T=T1 P=P1": "-> tiedTo(T1, P1)", "goal": "tiedTo(T1, P1) AND no tiedTo(T1, P2) -> ()"},
        ),
        (
            "T1 on P1",
            (
                things("Both", None, "?T on P1 AND ?T heldBy R1"),
                things("Un", None, "?T on P1 AND NOT ?T on P1"),
            ),
            "",
            ["no on(T1, P1)", "no ()"],
            {"goal": "on(T1, P1) -> ()"},
        ),
        (
            "marked(T1)",
            (
                things("Mark", None, "marked(?T)"),
                service("Other", None, "marked(?T)", T="Cup"),
                things("Useless", None, "?T likes P1"),
            ),
            "",
            ["no marked(T1)", "no ()"],
            {"Mark T=T1": "-> marked(T1)", "goal": "marked(T1) -> ()"},
        ),
        (
            "T1 marriedTo T2",
            (MARRY,),
            "T1 marriedTo C1, R1 marriedTo T2",
            ["no marriedTo(T1, T2)", "no ()"],
            {"Marry A=T1 B=T2": "-> marriedTo(T1, T2)", "Marry A=T2 B=T1": "-> marriedTo(T1, T2)", "goal": "marriedTo(T1, T2) -> ()"},
        ),
        (
            "T1 marriedTo T2 AND NOT T1 marriedTo C1 AND NOT T2 marriedTo R1",
            (MARRY,),
            "T1 marriedTo C1, R1 marriedTo T2",
            ["marriedTo(C1, T1)", "marriedTo(R1, T2)", "no marriedTo(T1, T2)", "no ()"],
            {
                "Marry A=T1 B=T2": "-> marriedTo(T1, T2) AND no marriedTo(C1, T1)",
                "Marry A=T1 B=C1": "-> marriedTo(C1, T1) AND no marriedTo(T1, T2)",
                "Marry A=C1 B=T1": "-> marriedTo(C1, T1)",
                "Marry A=C1 B=T2": "-> no marriedTo(C1, T1)",
                "Marry A=T2 B=T1": "-> marriedTo(T1, T2) AND no marriedTo(R1, T2)",
                "Marry A=T2 B=C1": "-> no marriedTo(R1, T2) AND no marriedTo(T1, T2)",
                "goal": "marriedTo(T1, T2) AND no marriedTo(C1, T1) AND no marriedTo(R1, T2) -> ()",
            },
        ),
        (
            "T1 gluedTo P1 AND NOT T1 tiedTo P2",
            (
                GLUE,
                TIE,
            ),
            "T1 tiedTo P2, T1 tiedTo R1",
            ["tiedTo(T1, P2)", "no gluedTo(T1, P1)", "no ()"],
            {
                "Glue T=T1 P=P1": "-> gluedTo(T1, P1) AND no tiedTo(T1, P2)",
                "Glue T=T1 P=P2": "-> no gluedTo(T1, P1) AND no tiedTo(T1, P2)",
                "goal": "gluedTo(T1, P1) AND no tiedTo(T1, P2) -> ()",
            },
        ),
        (
            "T1 tiedTo P1 AND NOT T1 gluedTo P2",
            (
                GLUE,
                TIE,
            ),
            "T1 gluedTo P2",
            ["gluedTo(T1, P2)", "no tiedTo(T1, P1)", "no ()"],
            {
                "Glue T=T1 P=P1": "-> no gluedTo(T1, P2) AND no tiedTo(T1, P1)",
                "Glue T=T1 P=P2": "-> gluedTo(T1, P2) AND no tiedTo(T1, P1)",
                "Tie T=T1 P=P1": "-> no gluedTo(T1, P2) AND tiedTo(T1, P1)",
                "Tie T=T1 P=P2": "-> no gluedTo(T1, P2)",
                "goal": "tiedTo(T1, P1) AND no gluedTo(T1, P2) -> ()",
            },
        ),
        (
            "T1 on P1 AND NOT T1 on P2",
            (FREE_PUT,),
            "T1 on P1, T1 on P2",
            ["on(T1, P1)", "on(T1, P2)", "no ()"],
            {
                "goal": "on(T1, P1) AND no on(T1, P2) -> ()",
                "Put T=T1 P=P1": "-> no on(T1, P2) AND on(T1, P1)",
                "Put T=T1 P=P2": "-> no on(T1, P1) AND on(T1, P2)",
            },
        ),
        (
            "NOT T1 on P2 AND marked(T1)",
            (
                placing("Drop", "marked(?T)", "NOT ?T on ?P"),
                placing("Put", "?T on ?Q", "?T on ?P AND marked(?T)"),
            ),
            "T1 on P2",
            ["on *(T1)", "on(T1, P2)", "no marked(T1)", "no ()"],
            {
                "Put T=T1 P=P1": "on *(T1) -> marked(T1) AND no on(T1, P2) AND on *(T1)",
                "Put T=T1 P=P2": "on *(T1) -> marked(T1) AND on *(T1) AND on(T1, P2)",
                "goal": "marked(T1) AND no on(T1, P2) -> ()",
                "Drop T=T1 P=P2": "marked(T1) -> no on *(T1) IF on(T1, P2) AND no on(T1, P2) IF on(T1, P2)",
            },
        ),
        (
            "NOT T1 on P2 AND T1 on P1 AND marked(T1)",
            (
                placing("Drop", None, "NOT ?T on ?P AND marked(?T)"),
                placing("Put", None, "?T on ?P"),
            ),
            "T1 on P2",
            ["on(T1, P2)", "no marked(T1)", "no ()", "no NOT(('on', ('T1', 'P2')))"],
            {
                "Drop T=T1 P=P1": "-> marked(T1) AND no on(T1, P2) on(T1, P1) IF on(T1, P1)",
                "Drop T=T1 P=P2": "-> NOT(('on', ('T1', 'P2'))) AND marked(T1) AND no on(T1, P2) on(T1, P1) IF on(T1, P2)",
                "Put T=T1 P=P1": "-> NOT(('on', ('T1', 'P2'))) AND on(T1, P1)",
                "Put T=T1 P=P2": "-> no NOT(('on', ('T1', 'P2'))) AND on(T1, P2)",
                "goal": "on(T1, P1) AND marked(T1) AND NOT(('on', ('T1', 'P2'))) -> ()",
            },
        ),
        (
            "marked(T1)",
            (
                things("Mark", "?T heldBy ?R", "marked(?T)"),
                things("Take", "?T on ?P", "?T heldBy R1"),
            ),
            "T1 on P2",
            ["on *(T1)", "no heldBy *(T1)", "no marked(T1)", "no ()"],
            {
                "Take T=T1": "on *(T1) -> heldBy *(T1) AND no on *(T1)",
                "Mark T=T1": "heldBy *(T1) -> marked(T1)",
                "goal": "marked(T1) -> ()",
            },
        ),
        (
            "marked(T1)",
            (
                things("Mark", "NOT ?T heldBy R1", "marked(?T)"),
                things("Put", None, "?T on P1"),
            ),
            "T1 heldBy R1",
            ["heldBy(T1, R1)", "no marked(T1)", "no ()"],
            {"Mark T=T1": "no heldBy(T1, R1) -> marked(T1)", "Put T=T1": "-> no heldBy(T1, R1)", "goal": "marked(T1) -> ()"},
        ),
        (
            "T1.Clean = FALSE AND NOT T1.Level = 2 m",
            (
                things("Three", None, "?T.Level = 3 m AND ?T.Clean = FALSE"),
                things("Two", None, "?T.Level = 2 m"),
            ),
            "",
            ["no .Level(T1, 2 m)", "no .Clean(T1, FALSE)", "no ()"],
            {
                "Three T=T1": "-> .Clean(T1, FALSE) AND no .Level(T1, 2 m)",
                "Two T=T1": "-> .Level(T1, 2 m)",
                "goal": ".Clean(T1, FALSE) AND no .Level(T1, 2 m) -> ()",
            },
        ),
    ],
)
def test_what_moves_need_and_make(
    goal: str, services: tuple[ServiceType, ...], facts: str, first: list[str], expected: dict[str, str]
) -> None:
    task = make_task(goal, *services, facts=facts)
    assert format_initial(task) == first
    assert format_moves(task) == expected


def test_the_goal_is_a_fact_and_reaching_it_no_step() -> None:
    task = make_task("marked(T1)", things("Mark", None, "marked(?T)"))
    assert task.goal is not None
    assert format_assignment(task, task.goal) == "()"
    assert {format_action(move.action): (move.length, move.cost) for move in task.moves} == {"Mark T=T1": (1, 1.0), "goal": (0, 0.0)}
    assert make_task("marked(T1)").goal is None


def test_what_only_sets_a_counter_is_kept_when_counting() -> None:
    fill, mark = things("Fill", None, "?T.Count = 1"), things("Mark", None, "marked(?T)")
    task = make_task("T1.Count >= 1 AND marked(T1)", fill, mark, counting=True)
    assert format_moves(task) == {"Mark T=T1": "-> marked(T1)", "Fill T=T1": "->", "goal": "marked(T1) -> ()"}


def test_moves_are_made_when_what_they_need_is_so_and_change_what_their_conditions_allow() -> None:
    task = make_task("NOT T1 on P1 AND marked(T1)", placing("Drop", "?T on ?Q", "NOT ?T on ?P AND marked(?T)"), facts="T1 on P1")
    drop = {format_action(move.action): move for move in task.moves}
    effective_drop, idle_drop = drop["Drop T=T1 P=P1"], drop["Drop T=T1 P=P2"]
    assert format_initial(task) == ["on *(T1)", "on(T1, P1)", "no marked(T1)", "no ()"]
    assert [
        effective_drop.is_applicable(task.initial),
        idle_drop.is_applicable(task.initial),
        drop["goal"].is_applicable(task.initial),
    ] == [True, True, False]
    state_after = effective_drop.apply(task.initial)
    assert [format_assignment(task, place) for place in enumerate(state_after)] == ["no on *(T1)", "no on(T1, P1)", "marked(T1)", "no ()"]
    idle_state = idle_drop.apply(task.initial)
    assert [format_assignment(task, place) for place in enumerate(idle_state)] == ["on *(T1)", "on(T1, P1)", "marked(T1)", "no ()"]
    assert [effective_drop.is_applicable(state_after), drop["goal"].is_applicable(state_after), drop["goal"].is_applicable(idle_state)] == [
        False,
        True,
        False,
    ]

"""The whole of small tasks as engines get them: their variables, costs, devices and goals, and what operations need and change."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.ontology.services import ServiceType
from somrs.planner.grounding.finite_task import FiniteTask
from somrs.planner.grounding.merging import merge_task
from somrs.planner.grounding.task import Task
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
LAY = service("Lay", None, "?T on ?P", T="Thing", P="Place")
SHIFT = service("Shift", "?T on P1 AND NOT marked(?T)", "?T on P2 AND marked(?T)", T="Thing")
LIFT = service("Lift", "?T on P1", "NOT ?T on P1", T="Thing")
DROP = service("Drop", None, "NOT ?T on P1 AND marked(?T)", T="Thing")
MEND = service("Mend", "NOT marked(?T)", "?T likes P1", T="Thing")
SWAP = service("Swap", "marked(?T)", "NOT marked(?T) AND ?T likes P1", T="Thing")
BACK_SERVICE = service("Back", "?T likes P1", "NOT ?T likes P1 AND marked(?T)", T="Thing")
USE = service("Use", "marked(?T) AND NOT ?T likes P1", "?T tiedTo P1", T="Thing")
BIND = service("Bind", "NOT ?T likes P1", "?T tiedTo P1", T="Thing")
LEND = service("Lend", "?T likes P1", "NOT ?T likes P1 AND lent(?T, P1, P2)", T="Thing")
FETCH = service("Fetch", "lent(?T, P1, P2)", "NOT lent(?T, P1, P2) AND marked(?T)", T="Thing")
CLEAR = service("Clear", "?T on P2", "NOT ?T on P1 AND marked(?T)", T="Thing")
NONE_LABEL = "<none of those>"


def make_tasks(goal: str, *services: ServiceType, facts: str = "") -> tuple[Task, FiniteTask]:
    task = Task(ground_problem(make_world(goal, *services, facts=facts)))
    return task, merge_task(task)


def describe_task(goal: str, *services: ServiceType, facts: str = "") -> dict[str, list[str]]:
    """What the task says, in words."""
    task, finite_task = make_tasks(goal, *services, facts=facts)

    def name(variable: int, value: int) -> str:
        none_label = NONE_LABEL if len(finite_task.names) == 1 else f"no {finite_task.names[variable][0]}"
        return finite_task.names[variable][value].replace(NONE_LABEL, none_label)

    def effect(conditions: tuple[tuple[int, int], ...], variable: int, value: int) -> str:
        return name(variable, value) + "".join(f" if {name(*condition)}" for condition in conditions)

    lines = []
    for operation in finite_task.operations:
        preconditions, effects = (
            (name(*precondition) for precondition in operation.preconditions),
            (effect(*operation_effect) for operation_effect in operation.effects),
        )
        lines.append(f"{format_action(task.moves[operation.move].action)}: {' & '.join(preconditions)} -> {' & '.join(effects)}")
    return {
        "values": [", ".join(values) for values in finite_task.names],
        "initial": [name(*assignment) for assignment in enumerate(finite_task.initial)],
        "goal": [name(*assignment) for assignment in finite_task.goal],
        "exclusive": [", ".join(name(*assignment) for assignment in group) for group in finite_task.mutex_groups],
        "operations": lines,
    }


@pytest.mark.parametrize(
    ("goal", "services", "facts", "expected"),
    [
        (
            "T1 on P2",
            (PUT_SERVICE, TAKE_SERVICE, GO_SERVICE),
            "T1 on P1, R1 at P1, P2 near P1",
            {
                "values": ["heldBy(T1, R1), on(T1, P1), on(T1, P2), <none of those>", "at(R1, P1), at(R1, P2), <none of those>"],
                "initial": ["on(T1, P1)", "at(R1, P1)"],
                "goal": ["on(T1, P2)"],
                "exclusive": [],
                "operations": [
                    "Go To=P2 Provider=R1 From=P1: at(R1, P1) -> at(R1, P2)",
                    "Take T=T1 Provider=R1 P=P1: on(T1, P1) & at(R1, P1) -> heldBy(T1, R1)",
                    "Put T=T1 P=P1 Provider=R1: heldBy(T1, R1) & at(R1, P1) -> on(T1, P1)",
                    "Go To=P1 Provider=R1 From=P2: at(R1, P2) -> at(R1, P1)",
                    "Put T=T1 P=P2 Provider=R1: heldBy(T1, R1) & at(R1, P2) -> on(T1, P2)",
                    "Take T=T1 Provider=R1 P=P2: on(T1, P2) & at(R1, P2) -> heldBy(T1, R1)",
                ],
            },
        ),
        (
            "marked(T1) OR marked(T2)",
            (MARK,),
            "",
            {
                "values": ["marked(T2), <none of those>", "(), <none of those>", "marked(T1), <none of those>"],
                "initial": ["no marked(T2)", "no ()", "no marked(T1)"],
                "goal": ["()"],
                "exclusive": [],
                "operations": [
                    "Mark T=T1:  -> marked(T1)",
                    "Mark T=T2:  -> marked(T2)",
                    "goal: marked(T2) -> ()",
                    "goal: marked(T1) -> ()",
                ],
            },
        ),
        (
            "T1 on P1",
            (LAY,),
            "T1 on P1",
            {
                "values": ["on(T1, P1), <none of those>"],
                "initial": ["on(T1, P1)"],
                "goal": ["on(T1, P1)"],
                "exclusive": [],
                "operations": ["Lay T=T1 P=P1:  -> on(T1, P1)"],
            },
        ),
        (
            "NOT T1 on P1 AND T1 likes P1 AND T2 on P1",
            (LAY, LIFT, MEND, MARK),
            "T1 on P1",
            {
                "values": ["on(T1, P1), <none of those>", "on(T2, P1), <none of those>", "likes(T1, P1), <none of those>"],
                "initial": ["on(T1, P1)", "no on(T2, P1)", "no likes(T1, P1)"],
                "goal": ["likes(T1, P1)", "on(T2, P1)", "no on(T1, P1)"],
                "exclusive": [],
                "operations": [
                    "Mend T=T1:  -> likes(T1, P1)",
                    "Lay T=T1 P=P1:  -> on(T1, P1)",
                    "Lay T=T1 P=P2:  -> no on(T1, P1)",
                    "Lift T=T1: on(T1, P1) -> no on(T1, P1)",
                    "Lay T=T2 P=P1:  -> on(T2, P1)",
                ],
            },
        ),
        (
            "NOT T1 on P1 AND marked(T1)",
            (DROP, LAY),
            "T1 on P1, T2 on P1",
            {
                "values": ["on(T1, P1), <none of those>", "marked(T1), <none of those>"],
                "initial": ["on(T1, P1)", "no marked(T1)"],
                "goal": ["marked(T1)", "no on(T1, P1)"],
                "exclusive": [],
                "operations": [
                    "Drop T=T1:  -> no on(T1, P1) & marked(T1)",
                    "Lay T=T1 P=P1:  -> on(T1, P1)",
                    "Lay T=T1 P=P2:  -> no on(T1, P1)",
                ],
            },
        ),
        (
            "T1 on P2 AND T1 heldBy R1 OR T1 on P2 AND marked(T2)",
            (SHIFT, LAY, MARK),
            "T1 on P1",
            {
                "values": [
                    "on(T1, P1), on(T1, P2), <none of those>",
                    "on(T2, P1), <none of those>",
                    "marked(T2), <none of those>",
                    "marked(T1), <none of those>",
                ],
                "initial": ["on(T1, P1)", "no on(T2, P1)", "no marked(T2)", "no marked(T1)"],
                "goal": ["on(T1, P2)", "marked(T2)"],
                "exclusive": [],
                "operations": [
                    "Shift T=T1: on(T1, P1) & no marked(T1) -> on(T1, P2) & marked(T1)",
                    "Mark T=T2:  -> marked(T2)",
                    "Lay T=T1 P=P2:  -> on(T1, P2)",
                    "Lay T=T1 P=P1:  -> on(T1, P1)",
                    "Lay T=T2 P=P1:  -> on(T2, P1)",
                    "Shift T=T2: on(T2, P1) & no marked(T2) -> no on(T2, P1) & marked(T2)",
                ],
            },
        ),
        (
            "NOT T1 on P1 AND NOT T1 on P2 AND marked(T1)",
            (LAY, LIFT, MARK),
            "T1 on P1",
            {
                "values": [
                    "on(T1, P1), on(T1, P2), <none of those>",
                    "marked(T1), <none of those>",
                    "NOT(('on', ('T1', 'P1'))), <none of those>",
                    "NOT(('on', ('T1', 'P2'))), <none of those>",
                ],
                "initial": ["on(T1, P1)", "no marked(T1)", "no NOT(('on', ('T1', 'P1')))", "NOT(('on', ('T1', 'P2')))"],
                "goal": ["marked(T1)", "NOT(('on', ('T1', 'P1')))", "NOT(('on', ('T1', 'P2')))"],
                "exclusive": [],
                "operations": [
                    "Mark T=T1:  -> marked(T1)",
                    "Lay T=T1 P=P1:  -> on(T1, P1) & no NOT(('on', ('T1', 'P1'))) & NOT(('on', ('T1', 'P2')))",
                    "Lay T=T1 P=P2:  -> on(T1, P2) & NOT(('on', ('T1', 'P1'))) & no NOT(('on', ('T1', 'P2')))",
                    "Lift T=T1: on(T1, P1) -> no on(T1, P1) & NOT(('on', ('T1', 'P1')))",
                ],
            },
        ),
        (
            "T1 tiedTo P1 AND T1 likes P1",
            (SWAP, BACK_SERVICE, USE),
            "marked T1",
            {
                "values": ["marked(T1), <none of those>", "likes(T1, P1), <none of those>", "tiedTo(T1, P1), <none of those>"],
                "initial": ["marked(T1)", "no likes(T1, P1)", "no tiedTo(T1, P1)"],
                "goal": ["tiedTo(T1, P1)", "likes(T1, P1)"],
                "exclusive": ["likes(T1, P1), marked(T1)"],
                "operations": [
                    "Use T=T1: no likes(T1, P1) -> tiedTo(T1, P1)",
                    "Swap T=T1: marked(T1) -> no marked(T1) & likes(T1, P1)",
                    "Back T=T1: likes(T1, P1) -> no likes(T1, P1) & marked(T1)",
                ],
            },
        ),
        (
            "T1 tiedTo P1 AND lent(T1, P1, P2)",
            (SWAP, LEND, FETCH, USE),
            "marked T1",
            {
                "values": ["lent(T1, P1, P2), likes(T1, P1), marked(T1), <none of those>", "tiedTo(T1, P1), <none of those>"],
                "initial": ["marked(T1)", "no tiedTo(T1, P1)"],
                "goal": ["tiedTo(T1, P1)", "lent(T1, P1, P2)"],
                "exclusive": [],
                "operations": [
                    "Use T=T1: marked(T1) -> tiedTo(T1, P1)",
                    "Swap T=T1: marked(T1) -> likes(T1, P1)",
                    "Lend T=T1: likes(T1, P1) -> lent(T1, P1, P2)",
                    "Fetch T=T1: lent(T1, P1, P2) -> marked(T1)",
                ],
            },
        ),
        (
            "T1 tiedTo P1 AND lent(T1, P1, P2)",
            (SWAP, LEND, FETCH, BIND),
            "marked T1",
            {
                "values": [
                    "lent(T1, P1, P2), marked(T1), <none of those>",
                    "likes(T1, P1), <none of those>",
                    "tiedTo(T1, P1), <none of those>",
                ],
                "initial": ["marked(T1)", "no likes(T1, P1)", "no tiedTo(T1, P1)"],
                "goal": ["tiedTo(T1, P1)", "lent(T1, P1, P2)"],
                "exclusive": ["lent(T1, P1, P2), likes(T1, P1), marked(T1)"],
                "operations": [
                    "Bind T=T1: no likes(T1, P1) -> tiedTo(T1, P1)",
                    "Swap T=T1: marked(T1) -> no lent(T1, P1, P2) & likes(T1, P1)",
                    "Lend T=T1: likes(T1, P1) -> no likes(T1, P1) & lent(T1, P1, P2)",
                    "Fetch T=T1: lent(T1, P1, P2) -> marked(T1)",
                ],
            },
        ),
        (
            "T1 on P2 AND marked(T1) AND NOT T1 on P1",
            (CLEAR, LAY),
            "T1 on P1",
            {
                "values": ["on(T1, P1), on(T1, P2), <none of those>", "marked(T1), <none of those>"],
                "initial": ["on(T1, P1)", "no marked(T1)"],
                "goal": ["on(T1, P2)", "marked(T1)"],
                "exclusive": [],
                "operations": ["Lay T=T1 P=P1:  -> on(T1, P1)", "Lay T=T1 P=P2:  -> on(T1, P2)", "Clear T=T1: on(T1, P2) -> marked(T1)"],
            },
        ),
    ],
)
def test_what_engines_are_told(goal: str, services: tuple[ServiceType, ...], facts: str, expected: dict[str, list[str]]) -> None:
    assert describe_task(goal, *services, facts=facts) == expected


@pytest.mark.parametrize(
    ("costs", "whole"),
    [
        (("1", "1"), [1, 1]),
        (("3", "2"), [3, 2]),
        (("3", "1.5"), [10_000, 5_000]),
        (("10000", "2"), [10_000, 2]),
        (("30000", "10000"), [10_000, 3_333]),
        (("0.3", "0.2"), [10_000, 6_667]),
    ],
)
def test_costs_are_whole_numbers_that_are_not_too_large(costs: tuple[str, str], whole: list[int]) -> None:
    dear, cheap = costs
    _, finite_task = make_tasks(
        "marked(T1) AND T1 on P2", structs.replace(MARK, cost=dear), structs.replace(LAY, cost=cheap), facts="T1 on P1"
    )
    assert sorted((operation.cost for operation in finite_task.operations), reverse=True) == whole


def test_operations_of_one_device_have_its_number() -> None:
    push = service("Push", "?Provider at P1", "?T on ?P", T="Thing", P="Place")
    task, finite_task = make_tasks("T1 on P2 AND marked(T2)", push, MARK, facts="R1 at P1")
    assert {format_action(task.moves[operation.move].action): operation.device for operation in finite_task.operations} == {
        "Push T=T1 P=P2 Provider=R1": 1,
        "Mark T=T2": 0,
    }

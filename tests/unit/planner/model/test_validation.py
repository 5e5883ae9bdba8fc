"""What is wrong with a plan, and how one reads."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from msgspec.structs import replace

from somrs.entish.parse import parse
from somrs.planner.model.plan import Link, Plan, Step
from somrs.planner.model.validation import validate
from tests.support.laboratory import TRANSFER, WASH, make_problem
from tests.support.sound_plans import make_sound_plan

PROBLEM = make_problem("Jar001.Clean = TRUE", TRANSFER, WASH)
PLAN = make_sound_plan(PROBLEM)


def changed(number: int, **fields: object) -> Plan:
    steps = [*PLAN.steps]
    steps[number] = replace(steps[number], **fields)
    return replace(PLAN, steps=tuple(steps))


@pytest.mark.parametrize(
    ("broken", "wrong"),
    [
        (lambda: PLAN, []),
        (lambda: changed(0, service_type="Carry"), ["no device offers Carry", "which does not hold by then"]),
        (lambda: changed(0, effect=parse("Jar001 isOn Shelf2")), ["is not what", "needs Jar001 isOn Washer1, which does not hold by then"]),
        (lambda: changed(1, precondition=parse("Jar001 isOn Shelf2")), ["needs Jar001 isOn Shelf2, which does not hold by then"]),
        (lambda: replace(PLAN, steps=PLAN.steps[:1], links=()), ["after all steps Jar001.Clean = TRUE does not hold"]),
        (lambda: Plan(), ["after all steps Jar001.Clean = TRUE does not hold"]),
    ],
)
def test_what_is_wrong_is_said(broken: Callable[[], Plan], wrong: list[str]) -> None:
    defects = validate(broken(), PROBLEM)
    assert len(defects) == len(wrong), defects
    for line, words in zip(defects, wrong, strict=True):
        assert words in line


def test_a_plan_reads_as_what_is_done_and_what_waits_for_what() -> None:
    assert str(PLAN).splitlines() == [
        "step1: TransferObject(Object: Jar001, Destination: Washer1)",
        "step2: WashJar(Jar: Jar001) by Washer1 after step1 (Jar001 isOn Washer1)",
    ]
    assert str(Plan()) == "nothing to do"


def test_steps_are_ready_when_what_they_wait_for_is_done() -> None:
    assert [step.id for step in PLAN.ready(())] == ["step1"]
    assert [step.id for step in PLAN.ready({"step1"})] == ["step2"]
    assert PLAN.ready({"step1", "step2"}) == ()


def test_links_that_run_in_a_circle_are_no_plan() -> None:
    steps = tuple(Step(id=id, service_type="WashJar", inputs={}, effect=parse("Jar001.Clean = TRUE")) for id in ("a", "b", "c"))
    circle = (Link("a", "b", "x"), Link("b", "c", "x"), Link("c", "b", "x"))
    with pytest.raises(ValueError, match=r"\['b', 'c'\]"):
        Plan(steps=steps, links=circle).topological()
    assert [step.id for step in Plan(steps=steps, links=(Link("c", "a", "x"),)).topological()] == ["b", "c", "a"]

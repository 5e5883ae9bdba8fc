"""How far the steps of a plan are, and which come next."""

from __future__ import annotations

from typing import Any

import pytest

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.planner.model.plan import Link, Plan, Step
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.workflow import Progress, StepRun, Workflow
from tests.unit.task_manager.execution.test_participants import OFFER, TransactionHarness


def step(id: str, object: str = "Jar1", **options: Any) -> Step:
    return Step(id, "Work", {"Object": Name(object)}, parse(f"{object}.Clean = TRUE"), **options)


def chain() -> Workflow:
    """The second step waits for the first, the third for both; the fourth for nobody."""
    links = (Link("a", "b", ""), Link("a", "c", ""), Link("b", "c", ""))
    return Workflow.from_plan(Plan(tuple(step(id, f"Jar{id}") for id in "abcd"), links), "1.1/", "undo1.", GoalKind.UNDO)


def ids(runs: list[StepRun]) -> str:
    return "".join(run.step.id for run in runs)


def member(transaction: TransactionHarness, step: str) -> Member:
    return transaction.invited(step)


def assign_step(workflow: Workflow, id: str, transaction: TransactionHarness, start: float = 0.0, finish: float = 10.0) -> Member:
    run = workflow.runs[id]
    participant = member(transaction, run.key)
    workflow.assign(run, participant, start, finish)
    return participant


def state(workflow: Workflow) -> tuple[str, str, bool, bool, bool]:
    return ids(workflow.open), ids(workflow.ready), workflow.arranged, workflow.busy, workflow.is_completed


def test_steps_are_known_by_their_names() -> None:
    workflow = chain()
    assert [(run.label, run.key, run.goal) for run in workflow] == [
        (f"undo1.{id}", f"1.1/{id}", GoalKind.UNDO) for id in ("a", "b", "c", "d")
    ]
    assert [run.step.id for run in workflow.predecessors("c")] == ["a", "b"]
    plain = Workflow.from_plan(Plan((step("a"),)))
    assert [(run.label, run.key, run.goal) for run in plain] == [("a", "a", GoalKind.TASK)]


def test_steps_are_arranged_when_those_before_are_promised_and_begin_when_they_are_done() -> None:
    workflow, transaction = chain(), TransactionHarness()
    assert state(workflow) == ("ad", "", False, False, False)
    workflow.move(workflow.runs["a"], Progress.ARRANGING)
    assert state(workflow) == ("d", "", False, False, False)
    assign_step(workflow, "a", transaction)
    assert state(workflow) == ("bd", "a", False, False, False)
    assign_step(workflow, "b", transaction)
    assign_step(workflow, "c", transaction)
    assert state(workflow) == ("d", "a", False, False, False)
    assign_step(workflow, "d", transaction)
    assert state(workflow) == ("", "ad", True, False, False)
    workflow.move(workflow.runs["a"], Progress.EXECUTING)
    assert state(workflow) == ("", "d", True, True, False)
    workflow.move(workflow.runs["a"], Progress.REPORTING)
    assert state(workflow) == ("", "d", True, True, False)
    workflow.move(workflow.runs["a"], Progress.COMPLETED)
    assert state(workflow) == ("", "bd", True, False, False)
    assert (ids(workflow.remaining), workflow.step_count, workflow.done_count) == ("bcd", 4, 1)
    workflow.release(workflow.runs["b"])
    assert state(workflow) == ("b", "d", False, False, False)
    for id in "bcd":
        workflow.move(workflow.runs[id], Progress.COMPLETED)
    assert state(workflow) == ("", "", True, False, True)
    assert (ids(workflow.remaining), workflow.done_count) == ("", 4)


def test_what_is_known_of_a_workflow_is_known_when_it_is_read_back() -> None:
    workflow, transaction = chain(), TransactionHarness()
    assign_step(workflow, "a", transaction, 1.0, 2.0)
    assign_step(workflow, "b", transaction, 3.0, 4.0)
    assign_step(workflow, "d", transaction, 5.0, 6.0)
    workflow.move(workflow.runs["a"], Progress.COMPLETED)
    workflow.move(workflow.runs["d"], Progress.EXECUTING)
    workflow.set_failure(workflow.runs["c"], "broken")
    read = Workflow(workflow.plan, workflow.runs)
    assert state(read) == state(workflow) == ("c", "b", False, True, False)
    assert read.failed is workflow.failed is workflow.runs["c"]
    assert sorted(read.promised("Robot1")) == sorted(workflow.promised("Robot1")) == [(3.0, 4.0), (5.0, 6.0)]
    assert (read.step_count, read.done_count) == (4, 1)


def test_a_service_has_a_step_until_it_loses_it() -> None:
    workflow, transaction = chain(), TransactionHarness()
    run = workflow.runs["a"]
    run.is_waiting = True
    participant = assign_step(workflow, "a", transaction, 1.0, 2.0)
    assert (run.participant, run.provider, run.start, run.finish, run.is_waiting) == (participant.id, "Robot1", 1.0, 2.0, False)
    assert (workflow.run_of(participant), workflow.held_by(participant)) == (run, run)
    other_participant = member(transaction, run.key)
    assert (workflow.run_of(other_participant), workflow.held_by(other_participant)) == (run, None)
    assert workflow.held_by(member(transaction, "elsewhere")) is None
    workflow.release(run, "it broke")
    assert (run.progress, run.participant, run.provider, run.failure) == (Progress.OPEN, None, None, "it broke")
    assert workflow.failed is run
    assert [*workflow.promised("Robot1")] == []
    workflow.set_failure(run, None)
    assert [step_run.failure for step_run in workflow] == [None] * 4
    assert workflow.failed is None


def test_the_first_of_the_steps_that_failed_is_recovered_first() -> None:
    workflow = chain()
    for id in "db":
        workflow.release(workflow.runs[id], "it broke")
    assert workflow.failed is workflow.runs["b"]


def test_a_step_can_start_when_those_before_it_are_promised_to_be_over() -> None:
    workflow, transaction = chain(), TransactionHarness()
    assign_step(workflow, "a", transaction, 0.0, 50.0)
    assign_step(workflow, "b", transaction, 50.0, 70.0)
    assert workflow.earliest_start(workflow.runs["c"], 10.0) == 70.0
    assert workflow.earliest_start(workflow.runs["c"], 80.0) == 80.0
    workflow.move(workflow.runs["b"], Progress.COMPLETED)
    assert workflow.earliest_start(workflow.runs["c"], 10.0) == 50.0
    assert workflow.earliest_start(workflow.runs["a"], 10.0) == 10.0


@pytest.mark.parametrize(
    ("steps", "adopted_id"),
    [
        ([step("x", "Jara")], "x"),
        ([step("x", "Jarb")], ""),
        ([step("x", "Jara"), step("y", "Jara")], "x"),
        ([step("x", "Jara", provider="Robot1")], "x"),
        ([step("x", "Jara", provider="Robot2")], ""),
        ([step("x", "Jara", provider="Robot2", alternative_providers=("Robot1",), device_group="g")], "x"),
        ([step("x", "Jara", provider="Robot2"), step("y", "Jara")], "y"),
    ],
)
def test_a_new_plan_takes_over_what_stands_of_the_old_one(steps: list[Step], adopted_id: str) -> None:
    old, transaction = Workflow.from_plan(Plan((step("a", "Jara"),)), "1.1/"), TransactionHarness()
    participant = assign_step(old, "a", transaction, 3.0, 4.0)
    old.runs["a"].precondition = parse("Jara.Open = TRUE")
    new = Workflow.from_plan(Plan(tuple(steps)), "1.2/")
    leftover = [*new.adopt(old, transaction.members)]
    adopted = [run for run in new if run.progress is Progress.ARRANGED]
    assert leftover == ([] if adopted_id else [participant])
    assert ids(adopted) == adopted_id
    for run in adopted:
        assert (run.participant, run.start, run.finish, run.step.provider in (None, "Robot1")) == (participant.id, 3.0, 4.0, True)
        assert (str(run.precondition), participant.step) == ("Jara.Open = TRUE", run.key)


@pytest.mark.parametrize("progress", [Progress.OPEN, Progress.ARRANGING, Progress.EXECUTING, Progress.COMPLETED])
def test_of_an_old_plan_only_what_is_promised_is_taken_over(progress: Progress) -> None:
    old, transaction = Workflow.from_plan(Plan((step("a"), step("b"))), "1.1/"), TransactionHarness()
    assign_step(old, "a", transaction)
    old.move(old.runs["a"], progress)
    second = assign_step(old, "b", transaction)
    old.runs["a"].provider = OFFER.provider
    new = Workflow.from_plan(Plan((step("x"),)), "1.2/")
    assert [*new.adopt(old, transaction.members)] == []
    assert new.runs["x"].participant == second.id


def test_two_promises_are_taken_over_by_two_steps() -> None:
    old, transaction = Workflow.from_plan(Plan((step("a"), step("b"), step("c"))), "1.1/"), TransactionHarness()
    participants = [assign_step(old, id, transaction) for id in "abc"]
    new = Workflow.from_plan(Plan((step("x"), step("y"))), "1.2/")
    assert [*new.adopt(old, transaction.members)] == [participants[2]]
    assert [run.participant for run in new] == [participants[0].id, participants[1].id]


def test_steps_of_one_device_are_bound_together() -> None:
    alike: dict[str, Any] = {"provider": "Robot2", "alternative_providers": ("Robot1",)}
    steps = (
        step("a", device_group="g", **alike),
        step("b", device_group="g", **alike),
        step("c", device_group="h", **alike),
        step("d", provider="Robot2"),
    )
    workflow = Workflow.from_plan(Plan(steps))
    workflow.bind(workflow.runs["d"], "Robot1")
    assert [run.step.provider for run in workflow] == ["Robot2"] * 4
    workflow.bind(workflow.runs["b"], "Robot1")
    assert [run.step.provider for run in workflow] == ["Robot1", "Robot1", "Robot2", "Robot2"]

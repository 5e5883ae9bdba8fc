"""Tasks, their participants and messages as clients see them."""

from __future__ import annotations

import pytest

from somrs.errors import FormulaError
from somrs.planner.model.plan import NoPlan, Obstacle, Plan
from somrs.protocol.messages import frp, previews
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.previews import Previewed
from somrs.protocol.messages.submission import Policy
from somrs.protocol.messages.task_views import ContractView, MessageView, Phase, StepView, TaskRow
from somrs.task_manager.transaction.views import contract_view, message_view, preview_reply, row, step_view, view, view_in_parts
from tests.unit.task_manager.test_preview import CHAIN
from tests.unit.task_manager.transaction.test_participant_events import (
    FIRST_SERVICE,
    GOAL,
    INITIAL_SITUATION,
    SECOND_SERVICE,
    TaskManagerHarness,
)

INPUTS = {"Object": "Jar002", "Destination": "Platform001"}


def test_a_task_is_seen_with_all_that_its_client_wanted() -> None:
    harness = TaskManagerHarness(precondition=INITIAL_SITUATION, policy=Policy.TIME, time_value=3.0, deadline=500.0, priority=5)
    harness.executing()
    harness.service_says(frp.Progress(fraction=0.25), 5.0)
    task_view = view(harness.task)
    assert (task_view.task, task_view.effect, task_view.client, task_view.submitted_at) == (harness.task.id, GOAL, "client", 0.0)
    assert (task_view.precondition, task_view.policy, task_view.time_value, task_view.deadline, task_view.priority) == (
        INITIAL_SITUATION,
        Policy.TIME,
        3.0,
        500.0,
        5,
    )
    assert (task_view.phase, task_view.outcome, task_view.ended_at, task_view.explanation, task_view.reasons) == (
        Phase.EXECUTING,
        None,
        None,
        "",
        (),
    )
    assert task_view.steps == (
        StepView(
            step="step1",
            service_type="TransferObject",
            inputs=INPUTS,
            state=State.EXECUTING,
            service=FIRST_SERVICE,
            price=10.0,
            duration=60.0,
            fraction=0.25,
        ),
    )
    assert [(work.step, work.service, work.state) for work in task_view.work] == [("step1", FIRST_SERVICE, State.EXECUTING)]


def test_a_step_that_is_nobodys_yet_has_no_price() -> None:
    (step,) = view(TaskManagerHarness().task).steps
    assert step == StepView(step="step1", service_type="TransferObject", inputs=INPUTS, state=State.ARRANGING)


@pytest.mark.parametrize("fraction", [0.0, 0.5, 1.0])
def test_a_row_says_how_much_of_the_plan_is_done(fraction: float) -> None:
    harness = TaskManagerHarness("Robot1", "Robot2", deadline=500.0, priority=2)
    harness.executing()
    harness.service_says(frp.Progress(fraction=fraction), 5.0)
    assert row(harness.task) == TaskRow(
        task=harness.task.id,
        effect=GOAL,
        phase=Phase.EXECUTING,
        submitted_at=0.0,
        client="client",
        deadline=500.0,
        due_at=500.0,
        priority=2,
        steps=1,
        done=0,
        fraction=fraction,
        services=(FIRST_SERVICE,),
    )
    harness.service_says(frp.Completed(situation=GOAL), 60.0)
    assert (row(harness.task).done, row(harness.task).fraction, row(harness.task).services) == (1, 1.0, ())


def test_a_row_without_a_plan_is_done_when_its_task_is_accomplished() -> None:
    harness = TaskManagerHarness(plan_results=[Plan()], effect=INITIAL_SITUATION)
    assert (row(harness.task).outcome, row(harness.task).steps, row(harness.task).fraction) == (Outcome.ACCOMPLISHED, 0, 1.0)
    harness = TaskManagerHarness(plan_results=[NoPlan("none")])
    assert (row(harness.task).outcome, row(harness.task).fraction, row(harness.task).explanation) == (Outcome.FAILED, 0.0, "no plan: none")


def test_a_long_task_is_seen_part_by_part(monkeypatch: pytest.MonkeyPatch) -> None:
    harness = TaskManagerHarness("Robot1", plan_results=[CHAIN], effect="Jar001 isOn Platform001 AND Tin001 isOn Platform001")
    for now in (1.0, 2.0):
        harness.offer(now)
    task_view = view(harness.task)
    assert (len(task_view.steps), len(task_view.work), view_in_parts(harness.task, 0)) == (2, 1, (task_view, None))
    parts = [view_in_parts(harness.task, offset) for offset in (1, 2, 3)]
    assert [(part.steps, part.work, rest) for part, rest in parts] == [
        (task_view.steps[1:], task_view.work, None),
        ((), task_view.work, None),
        ((), (), None),
    ]
    monkeypatch.setattr("somrs.task_manager.transaction.views.fit_page", lambda items, limit: [*items][:1] if limit == 3 else [*items][:0])
    parts = [view_in_parts(harness.task, offset) for offset in (0, 1, 2)]
    assert [(part.steps, part.work, rest) for part, rest in parts] == [
        (task_view.steps[:1], (), 1),
        (task_view.steps[1:], (), 2),
        ((), task_view.work, None),
    ]


def test_a_step_names_those_before_it_once_and_why_each_time() -> None:
    assert step_view(CHAIN.steps[1], CHAIN) == StepView(
        step="b",
        service_type="TransferObject",
        inputs={"Object": "Tin001", "Destination": "Platform001"},
        after=("a",),
        because=("Jar001 isOn Platform001",),
        brought_by=("a",),
    )
    twice = Plan(CHAIN.steps, CHAIN.links * 2)
    assert (step_view(twice.steps[1], twice).after, step_view(twice.steps[1], twice).brought_by) == (("a",), ("a", "a"))


@pytest.mark.parametrize(
    ("plan_result", "expected"),
    [
        (Plan(), Previewed(steps=(), explanation="nothing to do: it is so already")),
        (CHAIN, Previewed(steps=(step_view(CHAIN.steps[0], CHAIN), step_view(CHAIN.steps[1], CHAIN)))),
        (
            NoPlan("none", obstacles=(Obstacle.NO_OBJECT,)),
            Previewed(steps=(), explanation="none", reasons=("none",), obstacles=(previews.Obstacle.NO_OBJECT,)),
        ),
        (
            FormulaError("x", 0, "no"),
            Previewed(steps=(), explanation=str(FormulaError("x", 0, "no")), reasons=(str(FormulaError("x", 0, "no")),)),
        ),
        ("why", Previewed(steps=(), explanation="why", reasons=("why",))),
        (7, Previewed(steps=(), explanation="planning failed: 7", reasons=("planning failed: 7",))),
    ],
    ids=["nothing", "plan", "none", "formula", "why", "other"],
)
def test_what_the_planner_found_is_told(plan_result: object, expected: Previewed) -> None:
    assert preview_reply(plan_result) == expected


def test_a_contract_is_seen_from_the_asking_to_the_end() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    arranging_view = ContractView(
        participant=harness.member().id, service=FIRST_SERVICE, step="step1", state=State.ARRANGING, accepted=False, number=1, refused=False
    )
    assert contract_view(harness.member()) == arranging_view
    harness.service_says(frp.Terms(effect=GOAL, price=3.0, currency="PLN", duration=60.0, valid_until=90.0), 1.0)
    first = contract_view(harness.member())
    assert first == ContractView(
        participant=harness.member().id,
        service=FIRST_SERVICE,
        step="step1",
        state=State.OFFERED,
        accepted=False,
        price=3.0,
        currency="PLN",
        duration=60.0,
        valid_until=90.0,
        start=0.0,
        finish=60.0,
        number=1,
        refused=False,
    )
    harness.service_says(frp.Refuse(reason="too heavy"), 2.0, SECOND_SERVICE)
    second = contract_view(harness.member(SECOND_SERVICE))
    assert (second.state, second.refused, second.accepted, second.reason, second.start) == (State.ENDED, True, False, "too heavy", None)
    first = contract_view(harness.member())
    assert (first.state, first.accepted, first.reason) == (State.EXECUTING, True, "")


@pytest.mark.parametrize("participant", ["p", None])
def test_a_message_is_seen_as_it_passed(participant: str | None) -> None:
    header = Header(sender="a", recipient="b", message_id="m", reply_to="a", relates_to="n", transaction="t", participant=participant)
    assert message_view(3.0, Message(header=header, body=frp.Cancel(reason="no"))) == MessageView(
        at=3.0,
        type="Cancel",
        sender="a",
        recipient="b",
        participant=participant or "",
        id="m",
        relates_to="n",
        body='{"type":"Cancel","reason":"no"}',
    )

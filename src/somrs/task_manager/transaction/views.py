"""Tasks, steps, contracts, messages and plans as clients see them (the types of `protocol/messages/task_views.py`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType

import msgspec
from msgspec import structs

from somrs.entish import Attribute, Comparison, Formula, Name, Truth
from somrs.entish.formula import conjuncts
from somrs.errors import FormulaError
from somrs.ontology.types import UNKNOWN
from somrs.planner.model.plan import NoPlan, Plan, Step
from somrs.protocol.frp.states import WORKING
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.event_text import awaited_text, done_text, join_reasons, pause_text, sentence
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.paging import fit_page
from somrs.protocol.messages.previews import Obstacle, Previewed
from somrs.protocol.messages.task_views import ContractView, MessageView, StepView, TaskEvent, TaskRow, TaskView, WorkView
from somrs.task_manager.arrangement.plan_request import ServicesUnknown
from somrs.task_manager.execution.knowledge import output_texts, subjects
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.workflow import Progress, StepRun
from somrs.task_manager.transaction.state import LoggedEvent, TaskState, waiting_texts

STEP_STATE = {
    Progress.OPEN: State.NEW,
    Progress.ARRANGING: State.ARRANGING,
    Progress.ARRANGED: State.COMMITTED,
    Progress.EXECUTING: State.EXECUTING,
    Progress.REPORTING: State.EXECUTING,
    Progress.COMPLETED: State.COMPLETED,
}
"""The protocol state that clients see for the progress of a step."""


def view(task: TaskState) -> TaskView:
    """A task as clients see it."""
    return TaskView(
        task=task.id,
        effect=task.task.effect,
        phase=task.phase,
        submitted_at=task.submitted_at,
        outcome=task.outcome,
        ended_at=task.ended_at,
        explanation=join_reasons(_reasons(task)),
        reasons=_reasons(task),
        steps=tuple(_step_views(task)),
        recognise=task.task.recognise,
        findings=task.findings,
        work=tuple(work.view() for work in task.log),
        client=task.client,
        precondition=task.task.precondition,
        policy=task.task.policy,
        time_value=task.task.time_value,
        deadline=task.task.deadline,
        due_at=task.due_at,
        handlers=task.task.handlers,
        priority=task.task.priority,
        waits=task.task.waits,
        retry_of=task.task.retry_of,
        waiting_for=task.goal.waiting_for,
        waiting_to_retry=task.goal.waiting_to_retry,
        waiting_for_answer=task.awaited_answer.wait if task.awaited_answer is not None else None,
        pause=task.pause,
    )


def view_in_parts(task: TaskState, offset: int) -> tuple[TaskView, int | None]:
    """A task with a part of its steps and work: those after the first `offset` that fit into a message.

    Also returns the offset of the next part, or None after the last part.
    """
    task_view = view(task)
    parts = [*task_view.steps, *task_view.work]
    page = [*fit_page(parts[offset:], len(parts))]
    if len(page) == len(parts):
        return task_view, None
    steps, work = tuple(part for part in page if isinstance(part, StepView)), tuple(part for part in page if isinstance(part, WorkView))
    count = offset + len(page)
    return structs.replace(task_view, steps=steps, work=work), count if count < len(parts) else None


def row(task: TaskState) -> TaskRow:
    """A task as a row of a list."""
    workflow = task.goal.workflow
    working = [member for member in task.members.working if member.state in WORKING]
    count, done_count = (workflow.step_count, workflow.done_count) if workflow is not None else (0, 0)
    under_way = sum(member.fraction for member in working if workflow is not None and workflow.held_by(member) is not None)
    return TaskRow(
        task=task.id,
        effect=task.task.effect,
        phase=task.phase,
        submitted_at=task.submitted_at,
        outcome=task.outcome,
        ended_at=task.ended_at,
        explanation=join_reasons(_reasons(task)),
        reasons=_reasons(task),
        client=task.client,
        deadline=task.task.deadline,
        due_at=task.due_at,
        priority=task.task.priority,
        steps=count,
        done=done_count,
        fraction=min(1.0, (done_count + under_way) / count) if count else float(task.outcome is Outcome.ACCOMPLISHED),
        setbacks=task.setbacks,
        services=tuple(member.offer.service for member in working),
        waiting_for=task.goal.waiting_for,
        waiting_to_retry=task.goal.waiting_to_retry,
        waiting_for_answer=task.awaited_answer.wait if task.awaited_answer is not None else None,
        pause=task.pause,
    )


def _step_views(task: TaskState) -> Iterator[StepView]:
    """The steps of the plan of the task's goal, with those that are only foreseen."""
    workflow, outlook = task.goal.workflow, task.goal.outlook
    if workflow is None:
        return
    plan = outlook or workflow.plan
    yield from (_run_view(task, plan, run) for run in workflow)
    yield from foreseen_views(plan)


def foreseen_views(plan: Plan) -> Iterator[StepView]:
    """The steps that are planned again when it is known what the steps before them tell."""
    certain = {step.id for step in plan.certain_part.steps}
    yield from (step_view(step, plan, foreseen=True) for step in plan.topological() if step.id not in certain)


def _run_view(task: TaskState, plan: Plan, run: StepRun) -> StepView:
    member = task.members.find_known_member(run.participant)
    return step_view(
        run.step,
        plan,
        state=STEP_STATE[run.progress],
        service=member.offer.service if member else None,
        price=member.bid.terms.price if member and member.bid else None,
        currency=member.bid.terms.currency if member and member.bid else "EUR",
        duration=member.bid.terms.duration if member and member.bid else None,
        fraction=member.fraction if member else 0.0,
        note=member.note if member and member.state in WORKING else "",
        outputs=output_texts(run.outputs),
    )


def step_view(
    step: Step,
    plan: Plan,
    *,
    state: State = State.NEW,
    service: str | None = None,
    price: float | None = None,
    currency: str = "EUR",
    duration: float | None = None,
    fraction: float = 0.0,
    note: str = "",
    outputs: Mapping[str, str] = MappingProxyType({}),
    foreseen: bool = False,
) -> StepView:
    """A step of a plan as clients see it."""
    links = plan.links_to(step.id)
    return StepView(
        step=step.id,
        service_type=step.service_type,
        inputs={name: str(term) for name, term in step.inputs.items()},
        after=tuple(dict.fromkeys(link.before for link in links)),
        because=tuple(link.fact for link in links),
        condition=str(step.condition) if step.condition is not None else None,
        demanded_by=step.demanded_by,
        brought_by=tuple(link.before for link in links),
        state=state,
        service=service,
        price=price,
        currency=currency,
        duration=duration,
        fraction=fraction,
        note=note,
        kind=step.kind,
        learns=subjects(step),
        assumed=tuple(str(part) for part in _assumptions(step)),
        outputs=dict(outputs),
        foreseen=foreseen,
    )


def _assumptions(step: Step) -> Iterator[Formula]:
    """What the plan assumes that the step tells, without that an object is known then."""
    known = (Comparison(Attribute(Name(name), UNKNOWN), "=", Truth(False)) for name in step.finds)
    return (part for part in conjuncts(step.assumed) if part not in [*known]) if step.assumed is not None else iter(())


def preview_reply(result: object) -> Previewed:
    """The planner's result as the reply to a preview."""
    match result:
        case Plan():
            steps = (*(step_view(step, result) for step in result.certain_part.topological()), *foreseen_views(result))
            return Previewed(steps=steps, explanation="" if result.steps else done_text(result.doubts))
        case NoPlan():
            obstacles = tuple(Obstacle(obstacle.value) for obstacle in result.obstacles)
            return Previewed(steps=(), explanation=result.explanation, reasons=result.reasons, obstacles=obstacles)
        case FormulaError():
            return Previewed(steps=(), explanation=str(result), reasons=(str(result),))
        case ServicesUnknown(reason) | str(reason):
            return Previewed(steps=(), explanation=reason, reasons=(reason,))
        case _:
            reason = f"planning failed: {result}"
            return Previewed(steps=(), explanation=reason, reasons=(reason,))


def contract_view(member: Member) -> ContractView:
    """The contract of a participant, with its terms and its outcome."""
    session, terms, refusal = member.session, member.session.terms, member.refusal
    return ContractView(
        number=member.number,
        participant=member.id,
        service=member.offer.service,
        step=member.label,
        state=member.final_state or session.state,
        accepted="Accept" in session.sent_messages,
        refused="Refuse" in session.received_messages,
        not_now=refusal is not None and refusal.not_now,
        price=terms.price if terms is not None else None,
        currency=terms.currency if terms is not None else "EUR",
        duration=terms.duration if terms is not None else None,
        penalty=terms.penalty if terms is not None else None,
        valid_until=terms.valid_until if terms is not None else None,
        start=member.bid.start if member.bid is not None else None,
        finish=member.bid.finish if member.bid is not None else None,
        reason=member.exit_reason or (session.reason if member.final_state in (None, State.ENDED) else ""),
        condition=terms.condition if terms is not None else refusal.condition if refusal is not None else None,
    )


def _reasons(task: TaskState) -> tuple[str, ...]:
    """Why the task ended or is ending, or what it waits for."""
    paused = (pause_text(task.pause),) if task.pause is not None else ()
    awaited = (awaited_text(task.awaited_answer.wait),) if task.awaited_answer is not None else ()
    return (*paused, *awaited, *(task.reasons or waiting_texts(task.goal)))


def event_view(number: int, noted: LoggedEvent) -> TaskEvent:
    """An event with its sentence, as clients see it."""
    return TaskEvent(
        number=number, at=noted.at, text=sentence(noted.event), step=noted.step, goal=noted.goal, kind=noted.kind, event=noted.event
    )


def message_view(logged_at: float, message: Message) -> MessageView:
    """A protocol message, as clients see it."""
    header = message.header
    return MessageView(
        at=logged_at,
        type=type(message.body).__name__,
        sender=header.sender,
        recipient=header.recipient,
        participant=header.participant or "",
        id=header.message_id,
        relates_to=header.relates_to,
        body=msgspec.json.encode(message.body).decode(),
    )

"""Tasks, steps, contracts, messages and plans as clients see them (the values of `protocol/messages/clients.py`)."""

from __future__ import annotations

import msgspec
from msgspec import structs

from somrs.errors import FormulaError
from somrs.planner.model.plan import NoPlan, Plan, Step
from somrs.protocol.frp.states import WORKING
from somrs.protocol.messages.clients import ContractView, MessageView, Obstacle, Previewed, StepView, TaskEvent, TaskRow, TaskView, WorkView
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.event_text import join_reasons, sentence, waiting_text
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.paging import fit_page
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.workflow import Progress, StepRun
from somrs.task_manager.transaction.state import Noted, TaskState

STEP_STATE = {
    Progress.OPEN: State.NEW,
    Progress.ARRANGING: State.ARRANGING,
    Progress.ARRANGED: State.COMMITTED,
    Progress.EXECUTING: State.EXECUTING,
    Progress.REPORTING: State.EXECUTING,
    Progress.DONE: State.COMPLETED,
}
"""How a step looks to clients who know the protocol's states only."""


def view(task: TaskState) -> TaskView:
    """A transaction as clients see it."""
    workflow = task.goal.workflow
    return TaskView(
        task=task.id,
        effect=task.task.effect,
        phase=task.phase,
        submitted_at=task.submitted_at,
        outcome=task.outcome,
        ended_at=task.ended_at,
        explanation=join_reasons(_reasons(task)),
        reasons=_reasons(task),
        steps=tuple(_run_view(task, workflow.plan, run) for run in workflow) if workflow is not None else (),
        work=tuple(work.view() for work in task.log),
        client=task.client,
        precondition=task.task.precondition,
        policy=task.task.policy,
        time_value=task.task.time_value,
        deadline=task.task.deadline,
        handlers=task.task.handlers,
        priority=task.task.priority,
    )


def view_in_parts(task: TaskState, after: int) -> tuple[TaskView, int | None]:
    """A transaction with as many of its steps and its work behind the first `after` as fit a message; how many that makes, or None if
    these are the last."""
    seen = view(task)
    parts = [*seen.steps, *seen.work]
    page = [*fit_page(parts[after:], len(parts))]
    if len(page) == len(parts):
        return seen, None
    steps, work = tuple(one for one in page if isinstance(one, StepView)), tuple(one for one in page if isinstance(one, WorkView))
    count = after + len(page)
    return structs.replace(seen, steps=steps, work=work), count if count < len(parts) else None


def row(task: TaskState) -> TaskRow:
    """A transaction in a list."""
    workflow = task.goal.workflow
    working = [member for member in task.members.working if member.state in WORKING]
    count, done = (workflow.count, workflow.count_done) if workflow is not None else (0, 0)
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
        priority=task.task.priority,
        steps=count,
        done=done,
        fraction=min(1.0, (done + under_way) / count) if count else float(task.outcome is Outcome.ACCOMPLISHED),
        setbacks=task.setbacks,
        services=tuple(member.offer.service for member in working),
    )


def _run_view(task: TaskState, plan: Plan, run: StepRun) -> StepView:
    member = task.members.known(run.participant)
    return step_view(
        run.step,
        plan,
        state=STEP_STATE[run.progress],
        service=member.offer.service if member else None,
        price=member.bid.terms.price if member and member.bid else None,
        duration=member.bid.terms.duration if member and member.bid else None,
        fraction=member.fraction if member else 0.0,
    )


def step_view(
    step: Step,
    plan: Plan,
    *,
    state: State = State.NEW,
    service: str | None = None,
    price: float | None = None,
    duration: float | None = None,
    fraction: float = 0.0,
) -> StepView:
    """A step of a plan as clients see it."""
    links = plan.links_to(step.id)
    return StepView(
        step=step.id,
        service_type=step.service_type,
        inputs={name: str(term) for name, term in step.inputs.items()},
        after=tuple(dict.fromkeys(link.before for link in links)),
        because=tuple(link.fact for link in links),
        brought_by=tuple(link.before for link in links),
        state=state,
        service=service,
        price=price,
        duration=duration,
        fraction=fraction,
    )


def previewed(found: object) -> Previewed:
    """What the planner found, for a client that wanted to see only."""
    match found:
        case Plan():
            steps = tuple(step_view(step, found) for step in found.topological())
            return Previewed(steps=steps, explanation="" if found.steps else "nothing to do: it is so already")
        case NoPlan():
            obstacles = tuple(Obstacle(one.value) for one in found.obstacles)
            return Previewed(steps=(), explanation=found.explanation, reasons=found.reasons, obstacles=obstacles)
        case FormulaError():
            return Previewed(steps=(), explanation=str(found), reasons=(str(found),))
        case str(why):
            return Previewed(steps=(), explanation=why, reasons=(why,))
        case _:
            why = f"planning failed: {found}"
            return Previewed(steps=(), explanation=why, reasons=(why,))


def contract_view(member: Member) -> ContractView:
    """What became of a participant, and of the terms that it gave."""
    session, terms = member.session, member.session.terms
    return ContractView(
        number=member.number,
        participant=member.id,
        service=member.offer.service,
        step=member.label,
        state=member.left_in or session.state,
        accepted="Accept" in session.sent_messages,
        refused="Refuse" in session.received_messages,
        price=terms.price if terms is not None else None,
        currency=terms.currency if terms is not None else "EUR",
        duration=terms.duration if terms is not None else None,
        valid_until=terms.valid_until if terms is not None else None,
        start=member.bid.start if member.bid is not None else None,
        finish=member.bid.finish if member.bid is not None else None,
        reason=member.last_word or (session.reason if member.left_in in (None, State.ENDED) else ""),
    )


def _reasons(task: TaskState) -> tuple[str, ...]:
    """Why it ended, or ends, or what it waits for."""
    return task.reasons or ((waiting_text(task.goal.waits),) if task.goal.waits is not None else ())


def event_view(number: int, noted: Noted) -> TaskEvent:
    """Something that happened."""
    return TaskEvent(
        number=number, at=noted.at, text=sentence(noted.event), step=noted.step, goal=noted.goal, kind=noted.kind, event=noted.event
    )


def message_view(at: float, message: Message) -> MessageView:
    """A message as it passed."""
    header = message.header
    return MessageView(
        at=at,
        type=type(message.body).__name__,
        sender=header.sender,
        recipient=header.recipient,
        participant=header.participant or "",
        id=header.message_id,
        relates_to=header.relates_to,
        body=msgspec.json.encode(message.body).decode(),
    )

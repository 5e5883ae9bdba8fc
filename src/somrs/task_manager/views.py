"""Tasks, steps, contracts, messages and plans as clients see them (the values of `protocol/messages/clients.py`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
from msgspec import structs

from somrs.errors import FormulaError
from somrs.planner.model.plan import NoPlan, Plan, Step
from somrs.protocol.frp.states import WORKING
from somrs.protocol.messages.clients import ContractView, MessageView, Previewed, StepView, TaskRow, TaskView, WorkView
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.paging import fitting
from somrs.task_manager.participants import Member
from somrs.task_manager.workflow import Progress, StepRun

if TYPE_CHECKING:
    from somrs.task_manager.transaction import Transaction

STEP_STATE = {
    Progress.OPEN: State.NEW,
    Progress.ARRANGING: State.ARRANGING,
    Progress.ARRANGED: State.COMMITTED,
    Progress.EXECUTING: State.EXECUTING,
    Progress.REPORTING: State.EXECUTING,
    Progress.DONE: State.COMPLETED,
}
"""How a step looks to clients who know the protocol's states only."""


def view(transaction: Transaction) -> TaskView:
    """A transaction as clients see it."""
    workflow = transaction.wish.workflow
    return TaskView(
        task=transaction.id,
        effect=transaction.task.effect,
        phase=transaction.phase,
        submitted_at=transaction.submitted_at,
        outcome=transaction.outcome,
        ended_at=transaction.ended_at,
        explanation=transaction.explanation or transaction.wish.waits,
        steps=tuple(_run_view(workflow.plan, run) for run in workflow) if workflow is not None else (),
        work=tuple(work.view() for work in transaction.ledger),
        client=transaction.client,
        precondition=transaction.task.precondition,
        policy=transaction.task.policy,
        time_value=transaction.task.time_value,
        deadline=transaction.task.deadline,
        handlers=transaction.task.handlers,
        priority=transaction.task.priority,
    )


def view_in_parts(transaction: Transaction, after: int) -> tuple[TaskView, int | None]:
    """A transaction with as many of its steps and its work behind the first `after` as fit a message; how many that makes, or None if
    these are the last."""
    seen = view(transaction)
    parts = [*seen.steps, *seen.work]
    page = [*fitting(parts[after:], len(parts))]
    if len(page) == len(parts):
        return seen, None
    steps, work = tuple(one for one in page if isinstance(one, StepView)), tuple(one for one in page if isinstance(one, WorkView))
    count = after + len(page)
    return structs.replace(seen, steps=steps, work=work), count if count < len(parts) else None


def row(transaction: Transaction) -> TaskRow:
    """A transaction in a list."""
    workflow = transaction.wish.workflow
    working = [member for member in transaction.participants.working if member.state in WORKING]
    count, done = (workflow.count, workflow.count_done) if workflow is not None else (0, 0)
    under_way = sum(member.fraction for member in working if workflow is not None and workflow.held_by(member) is not None)
    return TaskRow(
        task=transaction.id,
        effect=transaction.task.effect,
        phase=transaction.phase,
        submitted_at=transaction.submitted_at,
        outcome=transaction.outcome,
        ended_at=transaction.ended_at,
        explanation=transaction.explanation or transaction.wish.waits,
        client=transaction.client,
        deadline=transaction.task.deadline,
        priority=transaction.task.priority,
        steps=count,
        done=done,
        fraction=min(1.0, (done + under_way) / count) if count else float(transaction.outcome is Outcome.ACCOMPLISHED),
        setbacks=transaction.setbacks,
        services=tuple(member.offer.service for member in working),
    )


def _run_view(plan: Plan, run: StepRun) -> StepView:
    member = run.member
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
            return Previewed(steps=(), explanation=found.explanation)
        case FormulaError():
            return Previewed(steps=(), explanation=str(found))
        case str(why):
            return Previewed(steps=(), explanation=why)
        case _:
            return Previewed(steps=(), explanation=f"planning failed: {found}")


def contract_view(member: Member) -> ContractView:
    """What became of a participant, and of the terms that it gave."""
    session, terms = member.session, member.session.terms
    return ContractView(
        number=member.number,
        participant=member.id,
        service=member.offer.service,
        step=member.label,
        state=member.left_in or session.state,
        accepted="Accept" in session.said,
        price=terms.price if terms is not None else None,
        currency=terms.currency if terms is not None else "EUR",
        duration=terms.duration if terms is not None else None,
        valid_until=terms.valid_until if terms is not None else None,
        start=member.bid.start if member.bid is not None else None,
        finish=member.bid.finish if member.bid is not None else None,
        reason=member.last_word or (session.reason if member.left_in in (None, State.ENDED) else ""),
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

"""What is kept of a task that is over: who wanted it, what came of it, with which terms and messages."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from somrs.protocol.clients import ContractView, MessageView, TaskRecord
from somrs.protocol.envelope import Message
from somrs.protocol.frp import State
from somrs.task_manager.participants import Member
from somrs.task_manager.views import view

if TYPE_CHECKING:
    from somrs.task_manager.transaction import Transaction


def record(transaction: Transaction) -> TaskRecord:
    """All that is kept of a transaction; it has just ended."""
    assert transaction.outcome is not None, "only what is over is kept"
    assert transaction.ended_at is not None, "only what is over is kept"
    seen, task = view(transaction), transaction.task
    return TaskRecord(
        task=transaction.id,
        client=transaction.client,
        effect=task.effect,
        precondition=task.precondition,
        policy=task.policy,
        deadline=task.deadline,
        submitted_at=transaction.submitted_at,
        ended_at=transaction.ended_at,
        outcome=transaction.outcome,
        explanation=transaction.explanation,
        steps=seen.steps,
        work=seen.work,
        contracts=tuple(_contract(member) for member in transaction.participants),
        events=tuple(transaction.events),
        messages=tuple(_message(at, message) for at, message in transaction.messages),
        priority=task.priority,
        time_value=task.time_value,
        handlers=task.handlers,
    )


def _contract(member: Member) -> ContractView:
    session, terms = member.session, member.session.terms
    return ContractView(
        participant=member.id,
        service=member.offer.service,
        step=member.label,
        state=member.left_in or session.state,
        accepted="Accept" in session.said,
        price=terms.price if terms is not None else None,
        currency=terms.currency if terms is not None else "EUR",
        duration=terms.duration if terms is not None else None,
        valid_until=terms.valid_until if terms is not None else None,
        reason=member.last_word or (session.reason if member.left_in in (None, State.ENDED) else ""),
    )


def _message(at: float, message: Message) -> MessageView:
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

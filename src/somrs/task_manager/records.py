"""What is kept of a task that is over: who wanted it, what came of it, with which terms and messages."""

from __future__ import annotations

from typing import TYPE_CHECKING

from somrs.protocol.messages.clients import TaskRecord
from somrs.task_manager.views import contract_view, message_view, view

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
        contracts=tuple(contract_view(member) for member in transaction.participants),
        events=tuple(transaction.events),
        messages=tuple(message_view(at, message) for at, message in transaction.messages),
        priority=task.priority,
        time_value=task.time_value,
        handlers=task.handlers,
    )

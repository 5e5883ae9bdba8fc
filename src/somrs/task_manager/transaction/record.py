"""The record of a task that has ended: its client, its outcome, its contracts, events and messages."""

from __future__ import annotations

from somrs.protocol.messages.records import TaskRecord
from somrs.task_manager.transaction.state import TaskState
from somrs.task_manager.transaction.views import contract_view, event_view, message_view, view


def record(state: TaskState) -> TaskRecord:
    """The record of a task that has just ended."""
    assert state.outcome is not None, "the task has ended"
    assert state.ended_at is not None, "the task has ended"
    task_view, task = view(state), state.task
    return TaskRecord(
        task=state.id,
        client=state.client,
        effect=task.effect,
        precondition=task.precondition,
        policy=task.policy,
        deadline=task.deadline,
        submitted_at=state.submitted_at,
        ended_at=state.ended_at,
        outcome=state.outcome,
        explanation=task_view.explanation,
        reasons=task_view.reasons,
        steps=task_view.steps,
        work=task_view.work,
        contracts=tuple(contract_view(member) for member in state.members),
        events=tuple(event_view(number, noted) for number, noted in enumerate(state.events, 1)),
        messages=tuple(message_view(entry.at, entry.message) for entry in state.messages),
        priority=task.priority,
        waits=task.waits,
        retry_of=task.retry_of,
        time_value=task.time_value,
        handlers=task.handlers,
        recognise=task.recognise,
        findings=state.findings,
    )

"""The report on a task: its steps, execution log, terms and events."""

from __future__ import annotations

from typing import Any

import msgspec

from somrs.errors import UsageError
from somrs.protocol.messages.event_text import short_id
from somrs.protocol.messages.previews import Previewed
from somrs.protocol.messages.records import TaskRecord
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import ContractView, Phase, TaskEvent, TaskRow, TaskView


class TaskReport(msgspec.Struct, frozen=True, kw_only=True):
    """A report on a task. `record`: None while the task runs."""

    view: TaskView
    events: tuple[TaskEvent, ...] = ()
    contracts: tuple[ContractView, ...] = ()
    record: TaskRecord | None = None

    @classmethod
    def from_record(cls, record: TaskRecord) -> TaskReport:
        return cls(view=view(record), events=record.events, contracts=record.contracts, record=record)


def view(record: TaskRecord) -> TaskView:
    """The view of an ended task, like that of a running one."""
    shared = {name: getattr(record, name) for name in TaskView.__struct_fields__ if name in TaskRecord.__struct_fields__}
    return TaskView(phase=Phase.ENDED, **shared)


def repetition(ended: TaskView) -> Submit:
    """The task that repeats an ended one. Raises UsageError if that one still runs."""
    if ended.phase is not Phase.ENDED:
        raise UsageError(f"{ended.effect} has not ended yet; cancel it first: `somrs cancel {short_id(ended.task)}`")
    shared = {name: getattr(ended, name) for name in Submit.__struct_fields__ if name != "retry_of"}
    return Submit(**shared, retry_of=ended.task)


def to_builtins(report: TaskReport) -> dict[str, Any]:
    """The report for programs: one flat object with the fields of `TaskView`, `events`, `contracts` and, if there is one, the record."""
    additions = {"events": report.events, "contracts": report.contracts}
    values: dict[str, Any] = msgspec.to_builtins(report.view) | msgspec.to_builtins(additions)
    return values if report.record is None else values | msgspec.to_builtins(report.record)


def is_named(id: str, name: str) -> bool:
    """Whether `name` is the task's id, or the beginning of it."""
    return bool(name) and (id == name or id.rpartition(":")[2].startswith(name.rpartition(":")[2].lower()))


def reasons(task: TaskView | TaskRow | TaskRecord | Previewed) -> tuple[str, ...]:
    """The reasons one by one; a record of SO-MRS 0.1 has only one explanation."""
    return task.reasons or ((task.explanation,) if task.explanation else ())

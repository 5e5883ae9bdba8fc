"""Everything that is known of one task: its steps, what was done and what became of it, terms, events, messages."""

from __future__ import annotations

from typing import Any

import msgspec

from somrs.protocol.messages.clients import ContractView, Phase, Previewed, TaskEvent, TaskRow, TaskView
from somrs.protocol.messages.records import TaskRecord


class TaskReport(msgspec.Struct, frozen=True, kw_only=True):
    """What is known of a task. Only of one that is over there is a record."""

    view: TaskView
    events: tuple[TaskEvent, ...] = ()
    contracts: tuple[ContractView, ...] = ()
    record: TaskRecord | None = None

    @classmethod
    def from_record(cls, record: TaskRecord) -> TaskReport:
        return cls(view=view(record), events=record.events, contracts=record.contracts, record=record)


def view(record: TaskRecord) -> TaskView:
    """A task that is over, as those that are not are seen."""
    shared = {name: getattr(record, name) for name in TaskView.__struct_fields__ if name in TaskRecord.__struct_fields__}
    return TaskView(phase=Phase.ENDED, **shared)


def to_builtins(report: TaskReport) -> dict[str, Any]:
    """For programs: one flat object, with the fields of a TaskView, and `events`; and of a TaskRecord, once there is one."""
    additions = {"events": report.events, "contracts": report.contracts}
    values: dict[str, Any] = msgspec.to_builtins(report.view) | msgspec.to_builtins(additions)
    return values if report.record is None else values | msgspec.to_builtins(report.record)


def is_named(id: str, name: str) -> bool:
    """Whether the name is the task's id, or the beginning of it."""
    return bool(name) and (id == name or id.rpartition(":")[2].startswith(name.rpartition(":")[2].lower()))


def reasons(task: TaskView | TaskRow | TaskRecord | Previewed) -> tuple[str, ...]:
    """Why it is so, each reason by itself; what SO-MRS 0.1 kept has the whole explanation only."""
    return task.reasons or ((task.explanation,) if task.explanation else ())

"""The records of tasks that are over, which clients read, and the Task Manager's archive keeps."""

from __future__ import annotations

from msgspec import Struct

from somrs.ontology.services import Handler
from somrs.protocol.messages.body import MessageBody
from somrs.protocol.messages.clients import ContractView, MessageView, Policy, StepView, TaskEvent, WorkView
from somrs.protocol.messages.frp import Outcome


class TaskRecord(Struct, frozen=True, kw_only=True, tag=True):
    """All that is kept of a task that is over: who wanted it, what came of it and when, with which terms and messages."""

    task: str
    client: str
    effect: str
    submitted_at: float
    ended_at: float
    outcome: Outcome
    explanation: str = ""
    reasons: tuple[str, ...] = ()
    """The explanation, each reason by itself."""
    precondition: str | None = None
    policy: Policy = Policy.PRICE
    deadline: float | None = None
    steps: tuple[StepView, ...] = ()
    work: tuple[WorkView, ...] = ()
    contracts: tuple[ContractView, ...] = ()
    events: tuple[TaskEvent, ...] = ()
    messages: tuple[MessageView, ...] = ()
    priority: int = 0
    time_value: float = 0.01
    handlers: tuple[Handler, ...] = ()


PARTS = ("steps", "work", "contracts", "events", "messages")
"""The parts of a record, in the order in which they are counted."""


class ReadRecords(MessageBody, frozen=True, kw_only=True, tag=True):
    """Tasks that are over, the latest first, up to `limit`: those that ended at `since` or later, with this `outcome`, whose id is
    `task` or begins so (without `urn:uuid:`, if one likes), with this `text` in what was wished for, whatever its case, and in which
    this `service`, or a service of this device, did something. `behind`: those behind this one in that order. `brief`: without
    contracts, events and messages; `without`: without these of a record's parts. `after`: of its steps, work, contracts, events and
    messages, in this order, those behind the first so many."""

    since: float | None = None
    outcome: Outcome | None = None
    task: str | None = None
    behind: str | None = None
    limit: int = 20
    brief: bool = False
    after: int = 0
    text: str | None = None
    service: str | None = None
    without: tuple[str, ...] = ()


class Records(MessageBody, frozen=True, kw_only=True, tag=True):
    """`more`: there is more. A page ends early when it becomes too long for a message. `rest`: the last record is too long for one
    by itself; ask for that task again, `after` so many of its parts. `total`: how many there are in all; not said of those
    `behind` another."""

    records: tuple[TaskRecord, ...]
    more: bool = False
    rest: int | None = None
    total: int | None = None

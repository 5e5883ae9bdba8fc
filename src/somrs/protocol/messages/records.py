"""The records of tasks that are over. Clients read them; the Task Manager's archive keeps them."""

from __future__ import annotations

from msgspec import Struct

from somrs.ontology.services import Handler
from somrs.protocol.messages.body import MessageBody
from somrs.protocol.messages.findings import Findings
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Policy
from somrs.protocol.messages.task_views import ContractView, MessageView, StepView, TaskEvent, WorkView


class TaskRecord(Struct, frozen=True, kw_only=True, tag=True):
    """The record of a task that is over: the client, the goal, the outcome, the times, the terms and the messages."""

    task: str
    client: str
    effect: str
    submitted_at: float
    ended_at: float
    outcome: Outcome
    explanation: str = ""
    reasons: tuple[str, ...] = ()
    """The reasons of which the explanation consists."""
    precondition: str | None = None
    policy: Policy = Policy.PRICE
    deadline: float | None = None
    steps: tuple[StepView, ...] = ()
    work: tuple[WorkView, ...] = ()
    contracts: tuple[ContractView, ...] = ()
    events: tuple[TaskEvent, ...] = ()
    messages: tuple[MessageView, ...] = ()
    priority: int = 0
    waits: bool = True
    retry_of: str | None = None
    time_value: float = 0.01
    handlers: tuple[Handler, ...] = ()
    recognise: bool = False
    findings: Findings | None = None
    task_manager: str = ""
    """The name of the Task Manager that has it; the client of a system with several fills it in."""


PARTS = ("steps", "work", "contracts", "events", "messages")
"""The parts of a record, in the order in which they are counted."""


class ReadRecords(MessageBody, frozen=True, kw_only=True, tag=True):
    """Read tasks that are over, the latest first, up to `limit`.

    `since`: ended at this time or later. `task`: the id, or its beginning, with or without `urn:uuid:`. `text`: contained in the goal, in
    either case. `service`: this service, or a service of this device, took part. `behind`: only those after this task in that order.
    `brief`: without contracts, events and messages; `without`: without these parts. `after`: omit this many of a record's steps, work,
    contracts, events and messages, counted in this order.
    """

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
    behind_at: float | None = None
    """When the task `behind` ended, if another Task Manager has its record."""


class Records(MessageBody, frozen=True, kw_only=True, tag=True):
    """A page of records. `more`: there are further ones. A page ends early when it becomes too long for a message.

    `rest`: the last record is too long for one message; request the same task with `after` set to this number. `total`: the number of all
    matching records; None in requests with `behind`.
    """

    records: tuple[TaskRecord, ...]
    more: bool = False
    rest: int | None = None
    total: int | None = None
    silent: tuple[str, ...] = ()
    """The Task Managers that did not answer the client of a system with several; their records are missing."""

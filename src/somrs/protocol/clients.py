"""The bodies between clients (people's windows, command line, other programs) and a Task Manager."""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

from somrs.ontology.services import Handler
from somrs.protocol.frp import Outcome, State


class Policy(StrEnum):
    """How arrangement chooses among Terms."""

    PRICE = "price"
    """The cheapest; the quicker of two that cost the same."""
    TIME = "time"
    """The one that is done first; the cheaper of two that are as quick."""
    WEIGHTED = "weighted"
    """The least price plus what its time is worth (`time_value` per second)."""


class Phase(StrEnum):
    """How far a task is."""

    PLANNING = "planning"
    WAITING = "waiting"
    """For another task, which has what this one needs."""
    ARRANGING = "arranging"
    EXECUTING = "executing"
    RECOVERING = "recovering"
    """Stopping what runs, or waiting for what a failure left to be known."""
    COMPENSATING = "compensating"
    """Undoing what was done."""
    ENDED = "ended"


class Submit(Struct, frozen=True, kw_only=True, tag=True):
    """A task: make `effect` true. `precondition` is the initial situation, if the client wants to state it. `deadline` in
    seconds from now. `time_value`: what a second is worth, in the currency of the terms, for the weighted policy. `handlers`
    go before those that come with service types."""

    effect: str
    precondition: str | None = None
    policy: Policy = Policy.PRICE
    time_value: float = 0.01
    deadline: float | None = None
    handlers: tuple[Handler, ...] = ()


class Submitted(Struct, frozen=True, kw_only=True, tag=True):
    task: str


class TaskRejected(Struct, frozen=True, kw_only=True, tag=True):
    """The task is not one: what is wrong with it."""

    problem: str


class CancelTask(Struct, frozen=True, kw_only=True, tag=True):
    task: str
    reason: str = "cancelled by the client"


class Cancelling(Struct, frozen=True, kw_only=True, tag=True):
    task: str


class StepView(Struct, frozen=True, kw_only=True):
    """One node of the plan. `after` are the ids of the steps that enable it, `because` the facts they bring about."""

    step: str
    service_type: str
    inputs: dict[str, str]
    after: tuple[str, ...] = ()
    because: tuple[str, ...] = ()
    state: State = State.NEW
    service: str | None = None
    price: float | None = None
    duration: float | None = None
    fraction: float = 0.0


class WorkView(Struct, frozen=True, kw_only=True):
    """What a service did, or began to do, in a task. `state` is what became of it in the end: Completed, Failed, Stopped,
    Unreachable, or, once it had to be undone, Compensated or Stranded; `result` how it ended before that, and `ended` when.
    `situation` is what it left; `before` what its undoing restores."""

    step: str
    service: str
    service_type: str
    inputs: dict[str, str]
    began: float
    state: State
    situation: str | None = None
    before: str | None = None
    note: str = ""
    result: State | None = None
    ended: float | None = None


class TaskView(Struct, frozen=True, kw_only=True):
    task: str
    effect: str
    phase: Phase
    submitted_at: float
    outcome: Outcome | None = None
    ended_at: float | None = None
    explanation: str = ""
    steps: tuple[StepView, ...] = ()
    work: tuple[WorkView, ...] = ()
    """All that services did, in the order in which they began, in this plan and those before."""


class ReadTasks(Struct, frozen=True, kw_only=True, tag=True):
    """The tasks that this Task Manager knows, newest first, up to `limit`: all, or those that are not over yet (`running`).
    `behind`: those behind this one in that order."""

    limit: int = 50
    running: bool = False
    behind: str | None = None


class Tasks(Struct, frozen=True, kw_only=True, tag=True):
    """`more`: there are older ones. A page ends early when it becomes too long for a message."""

    tasks: tuple[TaskView, ...]
    more: bool = False


class EventKind(StrEnum):
    """What an event is in the life of a task."""

    NEWS = "news"
    """It goes on."""
    SETBACK = "setback"
    """Something went wrong."""
    HANDLER = "handler"
    """A procedure that was laid down for a failure is begun."""
    REPLACE = "replace"
    """The ladder's first rung: another service takes the step."""
    REPLAN = "replan"
    """Its second rung: a new plan, from how things are now."""
    WAIT = "wait"
    """It waits for another task, or goes on."""
    LOOK = "look"
    """A cognitive service is to find out, or found out, what a failure left."""
    UNDO = "undo"
    """Its third and its last rung: what was done, or left, is undone."""
    END = "end"
    """The task is over."""


class TaskEvent(Struct, frozen=True, kw_only=True):
    """Something that happened to a task, in words: `number` counts from 1, `at` in seconds since 1970."""

    number: int
    at: float
    text: str
    step: str | None = None
    kind: EventKind = EventKind.NEWS


class WatchTask(Struct, frozen=True, kw_only=True, tag=True):
    """Answer as soon as there is an event behind number `after`, at the latest after `wait` seconds."""

    task: str
    after: int = 0
    wait: float = 20.0


class TaskNews(Struct, frozen=True, kw_only=True, tag=True):
    """`more`: there are events behind these already."""

    view: TaskView
    events: tuple[TaskEvent, ...]
    more: bool = False


class Preview(Struct, frozen=True, kw_only=True, tag=True):
    """Plan, but do not arrange."""

    effect: str
    precondition: str | None = None


class Previewed(Struct, frozen=True, kw_only=True, tag=True):
    """The steps of the plan; or none, and why there is none."""

    steps: tuple[StepView, ...]
    explanation: str = ""


class ContractView(Struct, frozen=True, kw_only=True):
    """A participant of a task that is over: the service, the step, the terms that it gave, whether they were accepted, and the state
    it was in at the end; if it had left before (Ended), the reason."""

    participant: str
    service: str
    step: str
    state: State
    accepted: bool
    price: float | None = None
    currency: str = "EUR"
    duration: float | None = None
    valid_until: float | None = None
    reason: str = ""


class MessageView(Struct, frozen=True, kw_only=True):
    """A message of a task as it was sent or received; `body` is JSON."""

    at: float
    type: str
    sender: str
    recipient: str
    participant: str
    id: str
    relates_to: str | None
    body: str


class TaskRecord(Struct, frozen=True, kw_only=True, tag=True):
    """All that is kept of a task that is over: who wanted it, what came of it and when, with which terms and messages."""

    task: str
    client: str
    effect: str
    submitted_at: float
    ended_at: float
    outcome: Outcome
    explanation: str = ""
    precondition: str | None = None
    policy: Policy = Policy.PRICE
    deadline: float | None = None
    steps: tuple[StepView, ...] = ()
    work: tuple[WorkView, ...] = ()
    contracts: tuple[ContractView, ...] = ()
    events: tuple[TaskEvent, ...] = ()
    messages: tuple[MessageView, ...] = ()


class ReadRecords(Struct, frozen=True, kw_only=True, tag=True):
    """Tasks that are over, the latest first, up to `limit`: those that ended at `since` or later, with this `outcome`, whose id is
    `task` or begins so (without `urn:uuid:`, if one likes), with this `text` in what was wished for, whatever its case, and in which
    this `service`, or a service of this device, did something. `behind`: those behind this one in that order. `brief`: without
    contracts, events and messages. `after`: of a record's steps, work, contracts, events and messages, in this order, those behind
    the first so many."""

    since: float | None = None
    outcome: Outcome | None = None
    task: str | None = None
    behind: str | None = None
    limit: int = 20
    brief: bool = False
    after: int = 0
    text: str | None = None
    service: str | None = None


class Records(Struct, frozen=True, kw_only=True, tag=True):
    """`more`: there is more. A page ends early when it becomes too long for a message. `rest`: the last record is too long for one
    by itself; ask for that task again, `after` so many of its parts. `total`: how many there are in all; not said of those
    `behind` another."""

    records: tuple[TaskRecord, ...]
    more: bool = False
    rest: int | None = None
    total: int | None = None

"""The bodies between clients (people's windows, command line, other programs) and a Task Manager."""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

from somrs.ontology.services import Handler
from somrs.protocol.messages.body import MessageBody
from somrs.protocol.messages.events import Event, EventKind, GoalKind
from somrs.protocol.messages.frp import Outcome, State


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


class Submit(MessageBody, frozen=True, kw_only=True, tag=True):
    """A task: make `effect` true. `precondition` is the initial situation, if the client wants to state it. `deadline` in
    seconds from now. `time_value`: what a second is worth, in the currency of the terms, for the weighted policy. `handlers`
    go before those that come with service types. `priority`: of tasks that wait for the same things, or for the same devices,
    the one with the higher number goes first; what is under way is not interrupted."""

    effect: str
    precondition: str | None = None
    policy: Policy = Policy.PRICE
    time_value: float = 0.01
    deadline: float | None = None
    handlers: tuple[Handler, ...] = ()
    priority: int = 0


class Submitted(MessageBody, frozen=True, kw_only=True, tag=True):
    task: str


class TaskRejected(MessageBody, frozen=True, kw_only=True, tag=True):
    """The task is not one: what is wrong with it."""

    problem: str


class CancelTask(MessageBody, frozen=True, kw_only=True, tag=True):
    task: str
    reason: str = "cancelled by the client"


class Cancelling(MessageBody, frozen=True, kw_only=True, tag=True):
    task: str


class StepView(Struct, frozen=True, kw_only=True):
    """One node of the plan. `after` are the ids of the steps that enable it, `because` the facts they bring about, and `brought_by`, for
    each of these facts, which of the steps."""

    step: str
    service_type: str
    inputs: dict[str, str]
    after: tuple[str, ...] = ()
    because: tuple[str, ...] = ()
    brought_by: tuple[str, ...] = ()
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
    goal: GoalKind = GoalKind.TASK


class TaskView(Struct, frozen=True, kw_only=True):
    """A task as it is: what was wanted by whom, how far it is, and what was done. `deadline` in seconds from `submitted_at`."""

    task: str
    effect: str
    phase: Phase
    submitted_at: float
    outcome: Outcome | None = None
    ended_at: float | None = None
    explanation: str = ""
    reasons: tuple[str, ...] = ()
    """The explanation, each reason by itself."""
    steps: tuple[StepView, ...] = ()
    work: tuple[WorkView, ...] = ()
    """All that services did, in the order in which they began, in this plan and those before."""
    client: str = ""
    precondition: str | None = None
    policy: Policy = Policy.PRICE
    time_value: float = 0.01
    deadline: float | None = None
    handlers: tuple[Handler, ...] = ()
    priority: int = 0


class TaskRow(Struct, frozen=True, kw_only=True):
    """A task in a list. `deadline` in seconds from `submitted_at`; `fraction`: how much of its plan is done, by the number of steps;
    `setbacks`: how often something went wrong."""

    task: str
    effect: str
    phase: Phase
    submitted_at: float
    outcome: Outcome | None = None
    ended_at: float | None = None
    explanation: str = ""
    reasons: tuple[str, ...] = ()
    """The explanation, each reason by itself."""
    client: str = ""
    deadline: float | None = None
    priority: int = 0
    steps: int = 0
    done: int = 0
    fraction: float = 0.0
    setbacks: int = 0
    services: tuple[str, ...] = ()
    """Those that are at work now."""


class ReadTasks(MessageBody, frozen=True, kw_only=True, tag=True):
    """The tasks that this Task Manager knows, newest first, up to `limit`: all, or those that are not over yet (`running`).
    `behind`: those behind this one in that order."""

    limit: int = 50
    running: bool = False
    behind: str | None = None


class Tasks(MessageBody, frozen=True, kw_only=True, tag=True):
    """`more`: there are older ones. A page ends early when it becomes too long for a message. Of a plan that is too long for one by itself,
    the first steps come; TaskNews has them all."""

    tasks: tuple[TaskView, ...]
    more: bool = False


class WatchTasks(MessageBody, frozen=True, kw_only=True, tag=True):
    """Answer as soon as a task changed after the change of number `after`, or there is a new one; at the latest after `wait` seconds. 0:
    all tasks that are known."""

    after: int = 0
    wait: float = 20.0


class TasksNews(MessageBody, frozen=True, kw_only=True, tag=True):
    """Those that changed, as they are now, in the order in which they did. `version`: the number of the last of these changes; ask for
    those after it. `more`: there are some already. `begun`: since when tasks are known here; when that is another than before, what was
    heard before is out of date."""

    rows: tuple[TaskRow, ...]
    version: int
    begun: float
    more: bool = False


class TaskEvent(Struct, frozen=True, kw_only=True):
    """Something that happened to a task: `number` counts from 1, `at` in seconds since 1970. `event` is what happened, for programs;
    `text` says it, for people; `goal` is what its step is done for. Records of SO-MRS 0.1 have the text only, those of 0.2.0 no goal."""

    number: int
    at: float
    text: str
    step: str | None = None
    goal: GoalKind | None = None
    kind: EventKind = EventKind.NEWS
    event: Event | None = None


class ContractView(Struct, frozen=True, kw_only=True):
    """A participant of a task: the service, the step, the terms that it gave, whether they were accepted, and the state that it is in, or
    was in when the task ended; if it left before (Ended), the reason, such as that another was chosen. `start`, `finish`: from when
    until when it would do the step, or is to do it, as was known when terms were chosen."""

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
    start: float | None = None
    finish: float | None = None
    number: int = 0
    """In the order in which they were asked."""
    refused: bool | None = None
    """Whether it answered that it does not do the step; SO-MRS 0.1 did not keep that."""


class WatchTask(MessageBody, frozen=True, kw_only=True, tag=True):
    """Answer as soon as there is an event behind number `after`, at the latest after `wait` seconds. With `messages`, also as soon as
    there are more messages of the protocol than so many; with `contracts`, also as soon as one changed after the change of that number.
    `parts`: of the view's steps and work, in this order, those behind the first so many."""

    task: str
    after: int = 0
    wait: float = 20.0
    messages: int | None = None
    contracts: int | None = None
    parts: int = 0


class TaskNews(MessageBody, frozen=True, kw_only=True, tag=True):
    """`more`: there are events, or contracts, behind these already. `rest`: the view is too long for one message; ask again for its
    `parts` behind so many. `messages`: how many there are. `contracts`: those that changed, if they were asked for, and `contracts_at` the
    number of the last of these changes. Of a task that is over, its record has contracts and messages."""

    view: TaskView
    events: tuple[TaskEvent, ...]
    more: bool = False
    messages: int = 0
    contracts: tuple[ContractView, ...] = ()
    contracts_at: int = 0
    rest: int | None = None


class Preview(MessageBody, frozen=True, kw_only=True, tag=True):
    """Plan, but do not carry it out. With `quotes`, services are asked for their terms, too, which nobody accepts; the best are chosen as
    they would be in a task with this `policy`, `time_value` and `deadline`."""

    effect: str
    precondition: str | None = None
    quotes: bool = False
    policy: Policy = Policy.PRICE
    time_value: float = 0.01
    deadline: float | None = None
    priority: int = 0


class Quotation(Struct, frozen=True, kw_only=True):
    """What a service answered when it was asked for a step: its terms, or (`reason`) why it gave none. `start` and `finish` in seconds from
    the preview. `chosen`: it would get the step. `estimate`: it was not asked now; this is what it asked last."""

    step: str
    service: str
    price: float | None = None
    currency: str = "EUR"
    duration: float | None = None
    start: float | None = None
    finish: float | None = None
    chosen: bool = False
    estimate: bool = False
    reason: str = ""


class Obstacle(StrEnum):
    """What stands in the way of a plan."""

    NO_SERVICE_TYPE = "no-service-type"
    """No service type that is known brings it about."""
    NOT_OFFERED = "not-offered"
    """Nobody offers a service that would bring it about."""
    PROMISED = "promised"
    """Who, or what, it takes is promised to other tasks, or nobody knows what state it is in."""
    PRECONDITION = "precondition"
    """The map denies what the client says of the beginning."""
    NO_OBJECT = "no-object"
    """There is no object of such a name on the map."""
    TWO_PLACES = "two-places"
    """Something would be in two places at a time."""


class Previewed(MessageBody, frozen=True, kw_only=True, tag=True):
    """The steps of the plan; or none, and why there is none: no steps and no `reasons` mean that it is so already. `waits`: a task would
    wait for others first, and for whom. With quotes: what services answered, in the order of the steps; the `price` of all steps together,
    and in how many `seconds` the last of them would be done; None where nobody offers a step (`unserved`: which, and why), or in several
    currencies."""

    steps: tuple[StepView, ...]
    explanation: str = ""
    reasons: tuple[str, ...] = ()
    """The explanation, each reason by itself."""
    obstacles: tuple[Obstacle, ...] = ()
    """What the reasons come to, for programs, as far as they are of these kinds."""
    waits: str = ""
    quotations: tuple[Quotation, ...] = ()
    price: float | None = None
    currency: str = "EUR"
    seconds: float | None = None
    estimate: bool = False
    """Some of the figures are estimates."""
    unserved: dict[str, str] = {}


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


class ReadMessages(MessageBody, frozen=True, kw_only=True, tag=True):
    """The messages of a task, whether it runs or is over, behind the first `after`, in the order in which they passed."""

    task: str
    after: int = 0


class Messages(MessageBody, frozen=True, kw_only=True, tag=True):
    """`more`: there are some behind these already."""

    messages: tuple[MessageView, ...]
    more: bool = False

"""The bodies between clients (windows, command line, other programs) and a Task Manager."""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

from somrs.ontology.services import Handler, ServiceKind
from somrs.protocol.messages.body import MessageBody
from somrs.protocol.messages.events import Event, EventKind, GoalKind, WaitsForTasks, WaitsToRetry
from somrs.protocol.messages.findings import Findings
from somrs.protocol.messages.frp import Outcome, State


class Policy(StrEnum):
    """How arrangement chooses among Terms."""

    PRICE = "price"
    """The lowest price; at equal prices, the earliest finish."""
    TIME = "time"
    """The earliest finish; at equal times, the lowest price."""
    WEIGHTED = "weighted"
    """The lowest sum of the price and the value of the time (`time_value` per second)."""


class Phase(StrEnum):
    """How far a task is."""

    PLANNING = "planning"
    WAITING = "waiting"
    """For another task, which has reserved objects that this task needs; or until a service can do a step."""
    ARRANGING = "arranging"
    EXECUTING = "executing"
    RECOVERING = "recovering"
    """Stopping the services that run, or finding out what a failure left."""
    COMPENSATING = "compensating"
    """Undoing what was done."""
    ENDED = "ended"


class Submit(MessageBody, frozen=True, kw_only=True, tag=True):
    """State a task: make `effect` true.

    `precondition` is the initial situation, if the client states it. `deadline` is in seconds from now. `time_value` is the value of a
    second, in the currency of the terms, for the weighted policy. `handlers` take precedence over those of the service types. `priority`:
    among tasks that wait for the same objects or devices, the one with the higher number goes first; work under way is not interrupted.
    `waits`: if no service can do it now, for reasons that pass, the task waits and tries again, until its deadline; otherwise it fails.
    `recognise`: find out whether, and for which objects and values, `effect` holds, instead of making it true (`findings.py`).
    `retry_of`: the id of the ended task that this one repeats.
    """

    effect: str
    precondition: str | None = None
    policy: Policy = Policy.PRICE
    time_value: float = 0.01
    deadline: float | None = None
    handlers: tuple[Handler, ...] = ()
    priority: int = 0
    waits: bool = True
    recognise: bool = False
    retry_of: str | None = None


class Submitted(MessageBody, frozen=True, kw_only=True, tag=True):
    task: str


class FormulaMistake(Struct, frozen=True, kw_only=True):
    """A mistake in a formula: the formula, the position in it (counted from 0), what is wrong there, and what was expected."""

    text: str
    position: int
    problem: str
    hint: str = ""


class TaskRejected(MessageBody, frozen=True, kw_only=True, tag=True):
    """The task is not valid, and why: for people, and for a mistake in one of its formulas also for programs."""

    problem: str
    mistake: FormulaMistake | None = None


class CancelTask(MessageBody, frozen=True, kw_only=True, tag=True):
    task: str
    reason: str = "cancelled by the client"


class Cancelling(MessageBody, frozen=True, kw_only=True, tag=True):
    task: str


class StepView(Struct, frozen=True, kw_only=True):
    """A step of the plan.

    `after` are the ids of the steps that enable it, `because` the facts that these bring about, and `brought_by` the step for each of these
    facts. `kind` is the kind of the service type. `condition` is the part of its precondition that the services `demanded_by` stated for
    it.

    `learns` is what a step finds out or computes: an object, an attribute, or a fact. `assumed` are the facts that the plan assumes it will
    find; `outputs` are the values that the service returned, as Entish terms. A step that is `foreseen` depends on what an earlier step
    learns, and is planned again when that is known.
    """

    step: str
    service_type: str
    inputs: dict[str, str]
    after: tuple[str, ...] = ()
    because: tuple[str, ...] = ()
    brought_by: tuple[str, ...] = ()
    state: State = State.NEW
    service: str | None = None
    price: float | None = None
    currency: str = "EUR"
    duration: float | None = None
    fraction: float = 0.0
    kind: ServiceKind = ServiceKind.PHYSICAL
    learns: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    outputs: dict[str, str] = {}
    foreseen: bool = False
    condition: str | None = None
    demanded_by: tuple[str, ...] = ()


class WorkView(Struct, frozen=True, kw_only=True):
    """The work of one service in a task, from its start.

    `state` is the final one: Completed, Failed, Stopped or Unreachable, or Compensated or Stranded after an attempt to undo it. `result` is
    the state in which the work itself ended, and `ended` the time. `situation` holds after the work; `before` is the situation that a
    compensation restores. `price` is that of the accepted terms; None in records of SO-MRS 0.2.
    """

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
    price: float | None = None
    currency: str = "EUR"


class TaskView(Struct, frozen=True, kw_only=True):
    """A task as it is now: the goal, the client, the phase and the work done. `deadline` is in seconds from `submitted_at`."""

    task: str
    effect: str
    phase: Phase
    submitted_at: float
    outcome: Outcome | None = None
    ended_at: float | None = None
    explanation: str = ""
    reasons: tuple[str, ...] = ()
    """The reasons of which the explanation consists."""
    steps: tuple[StepView, ...] = ()
    work: tuple[WorkView, ...] = ()
    """The work of all services, in the order in which it began, of this plan and of earlier ones."""
    client: str = ""
    precondition: str | None = None
    policy: Policy = Policy.PRICE
    time_value: float = 0.01
    deadline: float | None = None
    handlers: tuple[Handler, ...] = ()
    priority: int = 0
    waits: bool = True
    retry_of: str | None = None
    """The ended task that it repeats."""
    waiting_for: WaitsForTasks | None = None
    """The tasks that it waits for now; also in the reasons, as text."""
    waiting_to_retry: WaitsToRetry | None = None
    """Why there is no way to do it now, and when the next attempt is; also in the reasons, as text."""
    recognise: bool = False
    findings: Findings | None = None
    """The answer to a client that asks what is so, when the task has ended."""


class TaskRow(Struct, frozen=True, kw_only=True):
    """A task in a list.

    `deadline` is in seconds from `submitted_at`; `fraction` is the part of the plan that is done, by the number of steps; `setbacks` counts
    what went wrong.
    """

    task: str
    effect: str
    phase: Phase
    submitted_at: float
    outcome: Outcome | None = None
    ended_at: float | None = None
    explanation: str = ""
    reasons: tuple[str, ...] = ()
    """The reasons of which the explanation consists."""
    client: str = ""
    deadline: float | None = None
    priority: int = 0
    steps: int = 0
    done: int = 0
    fraction: float = 0.0
    setbacks: int = 0
    services: tuple[str, ...] = ()
    """The services that are working now."""
    waiting_for: WaitsForTasks | None = None
    """The tasks that it waits for now; also in the reasons, as text."""
    waiting_to_retry: WaitsToRetry | None = None
    """Why there is no way to do it now, and when the next attempt is; also in the reasons, as text."""
    recognise: bool = False
    """It asks what is so, and makes nothing so."""


class ReadTasks(MessageBody, frozen=True, kw_only=True, tag=True):
    """Read the tasks that this Task Manager knows, newest first, up to `limit`.

    `running`: only those that are not over. `behind`: only those after this task in that order.
    """

    limit: int = 50
    running: bool = False
    behind: str | None = None


class Tasks(MessageBody, frozen=True, kw_only=True, tag=True):
    """A page of tasks. `more`: there are older tasks.

    A page ends early when it becomes too long for a message. If a single plan is too long, the page has its first steps; TaskNews has all.
    """

    tasks: tuple[TaskView, ...]
    more: bool = False


class WatchTasks(MessageBody, frozen=True, kw_only=True, tag=True):
    """Wait for a change of any task after the change with the number `after`; answer after `wait` seconds at the latest.

    With `after` 0, the answer has all known tasks.
    """

    after: int = 0
    wait: float = 20.0


class TasksNews(MessageBody, frozen=True, kw_only=True, tag=True):
    """The tasks that changed, as they are now, in the order of their changes.

    `version` is the number of the last of these changes: request the later ones with `after`. `more`: there are later ones already. `begun`
    is the time from which this Task Manager knows tasks; when it differs from the one before, earlier answers are out of date.
    """

    rows: tuple[TaskRow, ...]
    version: int
    begun: float
    more: bool = False


class TaskEvent(Struct, frozen=True, kw_only=True):
    """An event in the life of a task.

    `number` counts from 1; `at` is in seconds since 1970. `event` is the event as data; `text` is the same as a sentence, for people;
    `goal` is what the step is done for. Records of SO-MRS 0.1 have the text only; those of 0.2.0 have no goal.
    """

    number: int
    at: float
    text: str
    step: str | None = None
    goal: GoalKind | None = None
    kind: EventKind = EventKind.NEWS
    event: Event | None = None


class ContractView(Struct, frozen=True, kw_only=True):
    """A participant of a task: the service, the step, its terms, whether they were accepted, and its present or last state.

    `reason`: why it left before the end (Ended), for example because another service was chosen. `start` and `finish`: the time of the
    step, as known when the terms were chosen.
    """

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
    """The position in the order in which the services were requested."""
    refused: bool | None = None
    """Whether the service refused the step; None in records of SO-MRS 0.1."""
    condition: str | None = None
    """What it demanded at the start of the step, in its terms or when it refused."""
    penalty: float | None = None
    """What it costs to have the work undone by this service, if its terms say so."""
    not_now: bool = False
    """Whether it refused for a reason that passes."""


class WatchTask(MessageBody, frozen=True, kw_only=True, tag=True):
    """Wait for an event after the number `after`; answer after `wait` seconds at the latest.

    `messages`: answer also as soon as there are more messages of the protocol than this. `contracts`: answer also as soon as a contract
    changed after the change with this number. `parts`: omit this many of the view's steps and work, counted in this order.
    """

    task: str
    after: int = 0
    wait: float = 20.0
    messages: int | None = None
    contracts: int | None = None
    parts: int = 0


class TaskNews(MessageBody, frozen=True, kw_only=True, tag=True):
    """The task and its news.

    `more`: there are further events or contracts. `rest`: the view is too long for one message; request the others with `parts` set to this
    number. `messages` is their count. `contracts` are those that changed, if they were requested, and `contracts_at` is the number of the
    last of these changes. When a task is over, its contracts and messages are in its record.
    """

    view: TaskView
    events: tuple[TaskEvent, ...]
    more: bool = False
    messages: int = 0
    contracts: tuple[ContractView, ...] = ()
    contracts_at: int = 0
    rest: int | None = None


class Preview(MessageBody, frozen=True, kw_only=True, tag=True):
    """Plan a task without executing it.

    With `quotes`, the answer has the terms of services, without contracts. The best terms are chosen as in a task with this `policy`,
    `time_value` and `deadline`.
    """

    effect: str
    precondition: str | None = None
    quotes: bool = False
    policy: Policy = Policy.PRICE
    time_value: float = 0.01
    deadline: float | None = None
    priority: int = 0
    recognise: bool = False


class Quotation(Struct, frozen=True, kw_only=True):
    """The answer of a service to a request for terms: the terms, or the `reason` why there are none.

    `start` and `finish` are in seconds from the preview. `chosen`: it would get the step. `estimate`: it received no request now; these are
    its latest terms. `condition`: what it demands at the start of the step, and the plan does not meet.
    """

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
    condition: str | None = None


class Obstacle(StrEnum):
    """Why there is no plan."""

    NO_SERVICE_TYPE = "no-service-type"
    """No known service type brings about the goal."""
    NOT_OFFERED = "not-offered"
    """The Registry has no offer of a service that would bring about the goal."""
    PROMISED = "promised"
    """The services or objects that a plan needs are reserved by other tasks."""
    UNKNOWN = "unknown"
    """The place and state of devices or objects that a plan needs are unknown since a failure."""
    PRECONDITION = "precondition"
    """The map contradicts the precondition of the client."""
    NO_OBJECT = "no-object"
    """The map has no object of this name."""
    TWO_PLACES = "two-places"
    """An object would be in two places at the same time."""


class Outlook(Struct, frozen=True, kw_only=True):
    """What a plan with foreseen steps costs in total, and how long it takes, if it goes on as foreseen.

    The certain steps count with their quotes. A foreseen step counts with the terms that services asked last or state in their offers: the
    prices at least and at most, and the time at least. `unknown`: the foreseen steps for which no terms are known; without them,
    `most_price` is None.
    """

    least_price: float
    most_price: float | None = None
    least_seconds: float = 0.0
    unknown: tuple[str, ...] = ()


class OtherPlan(Struct, frozen=True, kw_only=True):
    """Another plan for the same task, with the services, the price and the `seconds` of the best terms, as in `Previewed`."""

    steps: tuple[StepView, ...]
    price: float | None = None
    currency: str
    seconds: float | None = None
    outlook: Outlook | None = None


class Previewed(MessageBody, frozen=True, kw_only=True, tag=True):
    """The steps of the plan, or the `reasons` why there is none. No steps and no reasons: the goal already holds.

    `waiting_for`: the other tasks for which this one would wait; `waits`: the same as text. With quotes: the answers of the services in the
    order of the steps, the total `price`, and the `seconds` until the last step would be done; None if no service offers a step
    (`unserved`: which, and why), or for several currencies.
    """

    steps: tuple[StepView, ...]
    explanation: str = ""
    reasons: tuple[str, ...] = ()
    """The reasons of which the explanation consists."""
    obstacles: tuple[Obstacle, ...] = ()
    """The kinds of the reasons, for programs, as far as they are of a known kind."""
    waits: str = ""
    waiting_for: WaitsForTasks | None = None
    quotations: tuple[Quotation, ...] = ()
    price: float | None = None
    currency: str = "EUR"
    seconds: float | None = None
    estimate: bool = False
    """Some of the figures are estimates."""
    unserved: dict[str, str] = {}
    alternatives: tuple[OtherPlan, ...] = ()
    """With quotes: other plans, which use other service types. This one is preferred by the policy."""
    outlook: Outlook | None = None
    """With quotes, for a plan with foreseen steps: then `price` and `seconds` are None."""


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
    """Read the messages of a task, running or over, in the order in which they passed, without the first `after`."""

    task: str
    after: int = 0


class Messages(MessageBody, frozen=True, kw_only=True, tag=True):
    """A page of messages. `more`: there are further ones already."""

    messages: tuple[MessageView, ...]
    more: bool = False

"""Tasks as clients see them: the task, its steps, its work, its contracts, events and messages.

The requests that these answer are in `task_news.py`; the records of tasks that are over are in `records.py`.
"""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

from somrs.ontology.services import Handler, ServiceKind
from somrs.protocol.messages.event_kinds import EventKind
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.findings import Findings
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.submission import Policy
from somrs.protocol.messages.waits import WaitsForRepository, WaitsForTasks, WaitsToRetry


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


class StepView(Struct, frozen=True, kw_only=True):
    """A step of the plan.

    `after` are the ids of the steps that enable it, `because` the facts that these bring about, and `brought_by` the step for each of these
    facts. `kind` is the kind of the service type. `condition` is the part of its precondition that the services `demanded_by` stated for
    it.

    `learns` is what a step finds out or computes: an object, an attribute, or a fact. `assumed` are the facts that the plan assumes it will
    find; `outputs` are the values that the service returned, as Entish terms. A step that is `foreseen` depends on what an earlier step
    learns, and is planned again when that is known. `note` is what its service said last while it works.
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
    note: str = ""


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


class Pause(Struct, frozen=True, kw_only=True):
    """A task is paused. `by`: who has paused it; `since`: seconds since 1970."""

    by: str
    since: float


class TaskView(Struct, frozen=True, kw_only=True):
    """A task as it is now: the goal, the client, the phase and the work done. `deadline` is in seconds of the world's time, from
    `submitted_at`. `due_at` is when it is over, in seconds since 1970, as the world's time passes now; None: never, as it stands still."""

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
    due_at: float | None = None
    handlers: tuple[Handler, ...] = ()
    priority: int = 0
    waits: bool = True
    retry_of: str | None = None
    """The ended task that it repeats."""
    waiting_for: WaitsForTasks | None = None
    """The tasks that it waits for now; also in the reasons, as text."""
    waiting_to_retry: WaitsToRetry | None = None
    """Why there is no way to do it now, and when the next attempt is; also in the reasons, as text."""
    waiting_for_answer: WaitsForRepository | None = None
    """The Repository that does not answer; also in the reasons, as text."""
    pause: Pause | None = None
    """Who has paused it, if it is paused; also in the reasons, as text."""
    recognise: bool = False
    findings: Findings | None = None
    """The answer to a client that asks what is so, when the task has ended."""
    task_manager: str = ""
    """The name of the Task Manager that has it; the client of a system with several fills it in."""


class TaskRow(Struct, frozen=True, kw_only=True):
    """A task in a list.

    `deadline` and `due_at` are as in TaskView; `fraction` is the part of the plan that is done, by the number of steps; `setbacks` counts
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
    due_at: float | None = None
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
    waiting_for_answer: WaitsForRepository | None = None
    """The Repository that does not answer; also in the reasons, as text."""
    pause: Pause | None = None
    """Who has paused it, if it is paused; also in the reasons, as text."""
    recognise: bool = False
    """It asks what is so, and makes nothing so."""
    task_manager: str = ""
    """As in TaskView."""


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

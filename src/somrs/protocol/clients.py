"""The bodies between clients (people's windows, command line, other programs) and a Task Manager."""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

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
    ARRANGING = "arranging"
    EXECUTING = "executing"
    RECOVERING = "recovering"
    """Stopping what runs, or waiting for what a failure left to be known."""
    ENDED = "ended"


class Submit(Struct, frozen=True, kw_only=True, tag=True):
    """A task: make `effect` true. `precondition` is the initial situation, if the client wants to state it. `deadline` in
    seconds from now. `time_value`: what a second is worth, in the currency of the terms, for the weighted policy."""

    effect: str
    precondition: str | None = None
    policy: Policy = Policy.PRICE
    time_value: float = 0.01
    deadline: float | None = None


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


class TaskView(Struct, frozen=True, kw_only=True):
    task: str
    effect: str
    phase: Phase
    submitted_at: float
    outcome: Outcome | None = None
    ended_at: float | None = None
    explanation: str = ""
    steps: tuple[StepView, ...] = ()


class ReadTasks(Struct, frozen=True, kw_only=True, tag=True):
    """All tasks this Task Manager knows, newest first, up to `limit`."""

    limit: int = 50


class Tasks(Struct, frozen=True, kw_only=True, tag=True):
    tasks: tuple[TaskView, ...]


class TaskEvent(Struct, frozen=True, kw_only=True):
    """Something that happened to a task, in words: `number` counts from 1, `at` in seconds since 1970."""

    number: int
    at: float
    text: str
    step: str | None = None


class WatchTask(Struct, frozen=True, kw_only=True, tag=True):
    """Answer as soon as there is an event behind number `after`, at the latest after `wait` seconds."""

    task: str
    after: int = 0
    wait: float = 20.0


class TaskNews(Struct, frozen=True, kw_only=True, tag=True):
    view: TaskView
    events: tuple[TaskEvent, ...]


class Preview(Struct, frozen=True, kw_only=True, tag=True):
    """Plan, but do not arrange."""

    effect: str
    precondition: str | None = None


class Previewed(Struct, frozen=True, kw_only=True, tag=True):
    """The steps of the plan; or none, and why there is none."""

    steps: tuple[StepView, ...]
    explanation: str = ""

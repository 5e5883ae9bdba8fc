"""The kinds of the events of a task: what each means for the task."""

from __future__ import annotations

from enum import StrEnum

from somrs.protocol.messages.events import (
    Compensated,
    CompensationFailed,
    ConditionsAdopted,
    ContractForgotten,
    Event,
    FailuresUndone,
    FoundOut,
    GoalFailed,
    HandlerBegun,
    InvariantBroken,
    KnownOtherwise,
    LookBegun,
    LookFound,
    NobodyLooks,
    NotBegun,
    ObjectsDiscovered,
    Paused,
    Replanned,
    ReportRejected,
    Resumed,
    ServiceFaulted,
    ServiceLost,
    ServiceOverdue,
    ServiceReplaced,
    ServiceSilent,
    StepFailed,
    TaskEnded,
    TriedOnceMore,
    UndoingCheaper,
    UndoneByHandler,
    UndoneByOthers,
    UndoneByService,
    WorkStranded,
    WorkUndone,
)
from somrs.protocol.messages.waits import (
    GoesOn,
    RepositoryAnswered,
    WaitOver,
    WaitsForDevice,
    WaitsForRepository,
    WaitsForTasks,
    WaitsToRetry,
)


class EventKind(StrEnum):
    """The kind of an event in the life of a task."""

    NEWS = "news"
    """The task proceeds."""
    SETBACK = "setback"
    """Something went wrong."""
    HANDLER = "handler"
    """A handler for a failure begins."""
    REPLACE = "replace"
    """Another service takes the step."""
    REPLAN = "replan"
    """A new plan is made from the present situation."""
    WAIT = "wait"
    """The task waits for another task or for services, or continues."""
    LOOK = "look"
    """A cognitive service observes, or observed, what a failure left."""
    UNDO = "undo"
    """What was done, or what a failure left, is undone."""
    END = "end"
    """The task is over."""


KINDS: dict[type[Event], EventKind] = {
    **dict.fromkeys((WaitsForTasks, WaitsToRetry, WaitOver, GoesOn, WaitsForDevice, Paused, Resumed), EventKind.WAIT),
    **dict.fromkeys((WaitsForRepository, RepositoryAnswered), EventKind.WAIT),
    **dict.fromkeys((Replanned, TriedOnceMore, ConditionsAdopted), EventKind.REPLAN),
    **dict.fromkeys(
        (
            NotBegun, StepFailed, ServiceFaulted, ContractForgotten, ServiceSilent, ServiceOverdue, InvariantBroken, ServiceLost,
            ReportRejected, GoalFailed, CompensationFailed, WorkStranded,
        ),
        EventKind.SETBACK,
    ),
    ServiceReplaced: EventKind.REPLACE,
    HandlerBegun: EventKind.HANDLER,
    **dict.fromkeys((FoundOut, LookBegun, LookFound, NobodyLooks, KnownOtherwise, ObjectsDiscovered), EventKind.LOOK),
    UndoingCheaper: EventKind.UNDO,
    **dict.fromkeys((FailuresUndone, UndoneByHandler, UndoneByService, UndoneByOthers, Compensated, WorkUndone), EventKind.UNDO),
    TaskEnded: EventKind.END,
}  # fmt: skip
"""The kinds of events; all other events are news."""


def kind_of(event: Event) -> EventKind:
    return KINDS.get(type(event), EventKind.NEWS)

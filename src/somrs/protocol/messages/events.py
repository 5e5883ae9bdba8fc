"""What happens to a task: a closed union. Programs read these; `event_text.py` says them in sentences, for people.

Services are named as in the whole system (`Robot1.TransferObject`); formulas are Entish; prices are in the currency of the terms and
durations in seconds.
"""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

from somrs.protocol.messages.frp import Outcome


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


class GoalKind(StrEnum):
    """What a formula is made true for."""

    TASK = "task"
    """It is what the client wants."""
    HANDLER = "handler"
    """A procedure that was laid down for a failure."""
    LOOK = "look"
    """Nobody knows what a failure left; a cognitive service is to find out."""
    UNDO = "undo"
    """What was done is undone by other services than the one that did it."""


# From the goal to the plan


class TaskStated(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    effect: str


class Planned(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """There is a plan of so many steps; 0: it is so already."""

    steps: int


class WaitsForTasks(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """Other tasks have the objects that its plan needs. `tasks`: what each wants, by its id."""

    tasks: dict[str, str]
    objects: tuple[str, ...]


class GoesOn(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """What it waited for is free."""


class Replanned(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """A new plan is made, from how things are now."""

    reasons: tuple[str, ...]


class TriedOnceMore(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """There is no plan without services that failed; they may try again."""

    services: tuple[str, ...]


# Arrangement


class ServicesAsked(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """They were asked for their terms for the step."""

    services: tuple[str, ...]


class TermsOffered(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    service: str
    price: float
    currency: str
    duration: float


class ServiceRefused(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    service: str
    reason: str


class ServiceChosen(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """Its terms were accepted."""

    service: str
    price: float
    currency: str
    duration: float


# Execution


class WaitsForDevice(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The device does something else first."""

    device: str


class StepStarted(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    service: str


class ProgressNoted(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """A word of the service about its work."""

    service: str
    note: str


class StepCompleted(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    service: str
    situation: str


class StepStopped(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    service: str


class FoundSo(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """What a failed step was to bring about is so."""


# Failures


class NotBegun(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    service: str
    description: str


class StepFailed(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The service failed, with what it left, if it knows."""

    service: str
    description: str
    situation: str | None = None


class ServiceFaulted(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """It answered that it cannot take part any more."""

    service: str
    text: str


class ContractForgotten(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    service: str


class ServiceSilent(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """No sign of life came; it is asked for its state."""

    service: str


class ServiceOverdue(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """It takes far longer than it said. `undoing`: what it takes so long for."""

    service: str
    undoing: bool = False


class ServiceLost(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """Nothing is known of what it left. `silent`: it fell silent; otherwise it did not come to an end, or (`stopping`) did not say that it
    stopped."""

    service: str
    silent: bool = False
    stopping: bool = False


class ReportRejected(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The Repository rejects what the service reports."""

    service: str
    problems: tuple[str, ...]


# Recovery


class ServiceReplaced(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """Another service is to take the step."""


class MayTryAgain(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """Nobody else can do the step: those that failed are asked again."""

    services: tuple[str, ...]


class HandlerBegun(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The step failed, and this was laid down for that."""

    effect: str


class GoalFailed(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """What was pursued beside the task's own goal cannot be had."""

    goal: GoalKind
    step: str
    """For which it was pursued."""
    reasons: tuple[str, ...]


class LookBegun(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """Somebody is to look at the object, by a service of this type."""

    service_type: str
    object: str


class LookFound(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """Whoever looked saw this; None: nothing was said."""

    situation: str | None = None


class NobodyLooks(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """Nobody can look at the object: nothing is assumed about it."""

    object: str


class KnownOtherwise(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The map says something else of the object by now."""

    object: str
    problems: tuple[str, ...]


class FailuresUndone(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """There is no plan; what failures left is undone, so that there may be one."""

    reasons: tuple[str, ...]


class UndoneByHandler(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """Work is being undone by what was laid down for that."""

    effect: str


class UndoneByService(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The service that did the work is to restore the situation."""

    service: str
    situation: str


class UndoneByOthers(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """Other services are to restore the situation."""

    situation: str


class Compensated(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The service undid its work."""

    service: str
    situation: str


class CompensationFailed(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The service could not undo its work."""

    service: str
    description: str
    situation: str | None = None


class WorkUndone(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The work is undone."""


class WorkStranded(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The work is not undone. `taken`: another task has what it left; otherwise `reason` says why, if anybody did."""

    taken: bool = False
    reason: str = ""


# The end


class Stopping(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The client does not want it any more."""

    reason: str


class TaskEnded(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    outcome: Outcome
    reasons: tuple[str, ...] = ()


Event = (
    TaskStated | Planned | WaitsForTasks | GoesOn | Replanned | TriedOnceMore
    | ServicesAsked | TermsOffered | ServiceRefused | ServiceChosen
    | WaitsForDevice | StepStarted | ProgressNoted | StepCompleted | StepStopped | FoundSo
    | NotBegun | StepFailed | ServiceFaulted | ContractForgotten | ServiceSilent | ServiceOverdue | ServiceLost | ReportRejected
    | ServiceReplaced | MayTryAgain | HandlerBegun | GoalFailed | LookBegun | LookFound | NobodyLooks | KnownOtherwise
    | FailuresUndone | UndoneByHandler | UndoneByService | UndoneByOthers | Compensated | CompensationFailed | WorkUndone | WorkStranded
    | Stopping | TaskEnded
)  # fmt: skip

ServiceFailure = (
    NotBegun | StepFailed | ServiceFaulted | ContractForgotten | ServiceSilent | ServiceOverdue | ServiceLost | ReportRejected
    | CompensationFailed
)  # fmt: skip
"""What goes wrong with a service."""

KINDS: dict[type[Event], EventKind] = {
    **dict.fromkeys((WaitsForTasks, GoesOn, WaitsForDevice), EventKind.WAIT),
    **dict.fromkeys((Replanned, TriedOnceMore), EventKind.REPLAN),
    **dict.fromkeys(
        (
            NotBegun, StepFailed, ServiceFaulted, ContractForgotten, ServiceSilent, ServiceOverdue, ServiceLost, ReportRejected, GoalFailed,
            CompensationFailed, WorkStranded,
        ),
        EventKind.SETBACK,
    ),
    ServiceReplaced: EventKind.REPLACE,
    HandlerBegun: EventKind.HANDLER,
    **dict.fromkeys((LookBegun, LookFound, NobodyLooks, KnownOtherwise), EventKind.LOOK),
    **dict.fromkeys((FailuresUndone, UndoneByHandler, UndoneByService, UndoneByOthers, Compensated, WorkUndone), EventKind.UNDO),
    TaskEnded: EventKind.END,
}  # fmt: skip
"""What events are; all others are news."""


def kind_of(event: Event) -> EventKind:
    return KINDS.get(type(event), EventKind.NEWS)

"""The events of a task: a closed union. Programs read these; `event_text.py` makes sentences of them, for people.

Those of a task that waits are in `waits.py`; `event_kinds.py` says what each event means for its task.

Services have their names in the whole system (`Robot1.TransferObject`). Formulas are Entish. Prices are in the currency of the terms;
durations are in seconds.
"""

from __future__ import annotations

from msgspec import Struct

from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.waits import (
    GoesOn,
    Holder,
    RepositoryAnswered,
    WaitOver,
    WaitsForDevice,
    WaitsForRepository,
    WaitsForTasks,
    WaitsToRetry,
)

# From the goal to the plan


class TaskStated(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    effect: str


class Planned(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """There is a plan with this number of steps; 0: the goal already holds. `doubts`: then, the problems of devices that it is about.

    The last `foreseen` steps depend on what the others find out, and are planned again when that is known.
    """

    steps: int
    foreseen: int = 0
    doubts: tuple[str, ...] = ()


class Replanned(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """A new plan is made from the present situation."""

    reasons: tuple[str, ...]


class TriedOnceMore(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """There is no plan without services that failed; they may try again."""

    services: tuple[str, ...]


# Arrangement


class ServicesAsked(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The services received a request for terms for the step."""

    services: tuple[str, ...]


class UndoingCheaper(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """To undo what a failure left, for its penalty, and to do the rest as planned is estimated to cost less than to go on from there.

    The costs are what the policy of the task minimises: money, seconds, or both.
    """

    undoing: float
    going_on: float


class ComparedPlan(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A plan with the best terms for its steps: the total price, and the seconds until its last step would be done; None: no service takes
    one of the steps, or the currencies differ."""

    service_types: tuple[str, ...]
    price: float | None = None
    currency: str
    seconds: float | None = None


class PlansCompared(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """Services quoted several plans. `chosen`: the index of the plan that the policy of the task prefers."""

    plans: tuple[ComparedPlan, ...]
    chosen: int


class TermsOffered(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """`condition`: what the service demands at the start of the step."""

    service: str
    price: float
    currency: str
    duration: float
    condition: str | None = None


class ServiceRefused(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """`not_now`: the reason passes, and the service may do it later. `condition`: what would make it possible."""

    service: str
    reason: str
    not_now: bool = False
    condition: str | None = None


class ConditionsAdopted(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """A new plan takes the conditions of services into account. `conditions`: what each service demands for its step, by service."""

    conditions: dict[str, str]


class ServiceChosen(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The terms of the service were accepted."""

    service: str
    price: float
    currency: str
    duration: float


# Execution


class StepStarted(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    service: str


class ProgressNoted(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """A note of the service on its work, for people."""

    service: str
    note: str


class StepCompleted(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    service: str
    situation: str


class FoundOut(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The step told what it had to: a cognitive service found it out, or a service returned outputs, as Entish terms by name."""

    service: str
    situation: str | None = None
    outputs: dict[str, str] = {}


class StepStopped(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    service: str


class FoundSo(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The effect of a failed step holds."""


# Failures


class NotBegun(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    service: str
    description: str


class StepFailed(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The service failed. `situation`: what it left, if it knows."""

    service: str
    description: str
    situation: str | None = None


class ServiceFaulted(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The service answered that it can no longer take part."""

    service: str
    text: str


class ContractForgotten(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    service: str


class ServiceSilent(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """No heartbeat came; the Task Manager requests the state of the service."""

    service: str


class ServiceOverdue(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The service takes far longer than its terms say. `undoing`: to undo its work."""

    service: str
    undoing: bool = False


class InvariantBroken(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """What has to hold as long as the service works does not hold any more, through no fault of the service; it is stopped."""

    service: str
    invariant: str


class ServiceLost(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """It is unknown what the service left.

    `silent`: it fell silent; otherwise it did not finish, or (`stopping`) did not report that it stopped.
    """

    service: str
    silent: bool = False
    stopping: bool = False


class ReportRejected(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The Repository rejects the situation that the service reports."""

    service: str
    problems: tuple[str, ...]


class ReportSuperseded(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The map has newer news about parts of what the service reports."""

    service: str
    parts: tuple[str, ...]


class ObjectsDiscovered(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The service reports objects that the map did not have; they are on it now, under these names."""

    service: str
    objects: tuple[str, ...]


# Recovery


class ServiceReplaced(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """Another service is to take the step."""


class MayTryAgain(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """No other service can do the step; the services that failed are requested again."""

    services: tuple[str, ...]


class HandlerBegun(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The step failed; a handler with this effect begins."""

    effect: str


class GoalFailed(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """A goal besides the task's own cannot be achieved."""

    goal: GoalKind
    step: str
    """The step for which the goal was set."""
    reasons: tuple[str, ...]


class LookBegun(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """A service of this type is to observe the object."""

    service_type: str
    object: str


class LookFound(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The result of an observation; None: the service reported no situation."""

    situation: str | None = None


class NobodyLooks(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """No service can observe the object; nothing is assumed about it."""

    object: str


class KnownOtherwise(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The map has newer facts about the object."""

    object: str
    problems: tuple[str, ...]


class FailuresUndone(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """There is no plan; what failures left is undone, so that there may be one."""

    reasons: tuple[str, ...]


class UndoneByHandler(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """A handler with this effect undoes the work."""

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
    """The work is not undone. `taken`: other tasks, the `holders`, have reserved what it left; otherwise `reason` says why, if it is known.

    Events of SO-MRS 0.2 have no holders.
    """

    taken: bool = False
    reason: str = ""
    holders: tuple[Holder, ...] = ()


# Pauses


class Paused(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """An operator has paused the task."""

    author: str


class Resumed(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """An operator lets it go on."""

    author: str


# The end


class Stopping(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """The client cancelled the task."""

    reason: str


class TaskEnded(Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    outcome: Outcome
    reasons: tuple[str, ...] = ()


Event = (
    TaskStated | Planned | WaitsForTasks | WaitsToRetry | WaitOver | GoesOn | Replanned | TriedOnceMore
    | WaitsForRepository | RepositoryAnswered
    | UndoingCheaper | PlansCompared | ServicesAsked | TermsOffered | ServiceRefused | ConditionsAdopted | ServiceChosen
    | WaitsForDevice | StepStarted | ProgressNoted | StepCompleted | FoundOut | StepStopped | FoundSo
    | NotBegun | StepFailed | ServiceFaulted | ContractForgotten | ServiceSilent | ServiceOverdue | InvariantBroken | ServiceLost
    | ReportRejected | ReportSuperseded | ObjectsDiscovered
    | ServiceReplaced | MayTryAgain | HandlerBegun | GoalFailed | LookBegun | LookFound | NobodyLooks | KnownOtherwise
    | FailuresUndone | UndoneByHandler | UndoneByService | UndoneByOthers | Compensated | CompensationFailed | WorkUndone | WorkStranded
    | Paused | Resumed | Stopping | TaskEnded
)  # fmt: skip

ServiceFailure = (
    NotBegun | StepFailed | ServiceFaulted | ContractForgotten | ServiceSilent | ServiceOverdue | InvariantBroken | ServiceLost
    | ReportRejected | CompensationFailed
)  # fmt: skip
"""What can go wrong with a service."""

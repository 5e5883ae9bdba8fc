"""The timers of a Task Manager, and the questions to its node with their answers, as values."""

from __future__ import annotations

from msgspec import Struct

from somrs.kernel.component import ErrorAnswer
from somrs.kernel.replica import ReplicaDue
from somrs.kernel.service_replica import ServicesDue
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import Problem
from somrs.protocol.messages.records import ReadRecords, Records


class BidsDue(Struct, frozen=True, tag=True):
    """The time to answer Arrange is over, for steps of the goal with the number `goal`.

    In all timers, `owner` is the id of a task or of a preview.
    """

    owner: str
    goal: int


class SilenceDue(Struct, frozen=True, tag=True):
    """The heartbeat of a working participant is overdue."""

    owner: str
    participant: str


class OverdueDue(Struct, frozen=True, tag=True):
    """The time for a participant to finish is over."""

    owner: str
    participant: str


class DeadlineDue(Struct, frozen=True, tag=True):
    """The deadline of the task is over, in the world's time."""

    owner: str


class RetryDue(Struct, frozen=True, tag=True):
    """The pause before the next attempt of a waiting task is over."""

    owner: str


class StopDue(Struct, frozen=True, tag=True):
    """The time for all participants to stop is over."""

    owner: str


class PreviewDue(Struct, frozen=True, tag=True):
    """The time for the preview is over."""

    owner: str


class AnswerDue(Struct, frozen=True, tag=True):
    """The answer of the Repository or the Registry to a request is overdue."""

    request: str


class DiscoveryDue(Struct, frozen=True, tag=True):
    """The time for which tasks wait for the services on offer is over, or the providers that were to publish again have had their time."""


class MapDue(Struct, frozen=True, tag=True):
    """The time for which a client's request waits for the map is over."""

    request: str


class NewsDue(Struct, frozen=True, tag=True):
    """The time for which a client waits for news is over."""

    request: str


Timer = (
    BidsDue | SilenceDue | OverdueDue | DeadlineDue | RetryDue | StopDue | PreviewDue | AnswerDue | DiscoveryDue | MapDue | NewsDue
    | ReplicaDue | ServicesDue
)  # fmt: skip


class StartedBefore(Struct, frozen=True, tag=True):
    """A notice in journals of programs whose Task Managers kept reservations to themselves, and asked the Registry for each task: such a
    program was started."""


class PlanWanted(Struct, frozen=True, tag=True):
    """A plan for the goal with the number `goal`; `serial` counts its plans, `attempt` the planning problems of one plan."""

    owner: str
    goal: int
    serial: int
    attempt: int


class RecordsWanted(Struct, frozen=True, tag=True):
    """Records of the archive, for a client's request."""

    request: str


Question = PlanWanted | RecordsWanted
NodeTask = Problem | ReadRecords
Answer = Plan | NoPlan | Records | ErrorAnswer

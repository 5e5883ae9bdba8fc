"""What a Task Manager waits for, and what it asks of its node: as values."""

from __future__ import annotations

from msgspec import Struct

from somrs.kernel.component import ErrorAnswer
from somrs.kernel.replica import ReplicaDue
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import Problem
from somrs.protocol.messages.records import ReadRecords, Records


class BidsDue(Struct, frozen=True, tag=True):
    """The time to answer Arrange is over, for steps of the goal of that number. As of all timers, `owner` is a task, or a preview, by its
    id."""

    owner: str
    goal: int


class SilenceDue(Struct, frozen=True, tag=True):
    """A participant at work should have given a sign of life."""

    owner: str
    participant: str


class OverdueDue(Struct, frozen=True, tag=True):
    """A participant should have come to an end."""

    owner: str
    participant: str


class DeadlineDue(Struct, frozen=True, tag=True):
    """The task should be done."""

    owner: str


class StopDue(Struct, frozen=True, tag=True):
    """Everybody should have stopped."""

    owner: str


class PreviewDue(Struct, frozen=True, tag=True):
    """The preview has taken as long as it may."""

    owner: str


class AnswerDue(Struct, frozen=True, tag=True):
    """The Repository, or the Registry, should have answered the request."""

    request: str


class MapDue(Struct, frozen=True, tag=True):
    """The map should have been read, for a client's request to be carried out."""

    request: str


class NewsDue(Struct, frozen=True, tag=True):
    """A client has waited long enough for news."""

    request: str


Timer = BidsDue | SilenceDue | OverdueDue | DeadlineDue | StopDue | PreviewDue | AnswerDue | MapDue | NewsDue | ReplicaDue


class PlanWanted(Struct, frozen=True, tag=True):
    """A plan for the goal of that number: `serial` counts its plans, `attempt` the problems that were made for one of them."""

    owner: str
    goal: int
    serial: int
    attempt: int


class RecordsWanted(Struct, frozen=True, tag=True):
    """What is in the archive, for a client's request."""

    request: str


Question = PlanWanted | RecordsWanted
NodeTask = Problem | ReadRecords
Answer = Plan | NoPlan | Records | ErrorAnswer

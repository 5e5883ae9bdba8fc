"""What a Service Manager waits for, asks of its node, and hears from its device's program: as values."""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

from somrs.service_manager.sdk.orders import Halt, Perform, Profile, Quote, Report, Undo


class TermsDue(Struct, frozen=True, tag=True):
    """The terms that were offered to the participant expire."""

    transaction: str
    participant: str


class StartDue(Struct, frozen=True, tag=True):
    """The participant should have been told to start."""

    transaction: str
    participant: str


class HeartbeatDue(Struct, frozen=True, tag=True):
    """It is time for a sign of life from the participant at work."""

    transaction: str
    participant: str


class JoiningDue(Struct, frozen=True, tag=True):
    """A step of joining should have been answered, or the lease is to be renewed."""


class ReportDue(Struct, frozen=True, tag=True):
    """The Repository should have answered what the device reported to it."""


ParticipantTimer = TermsDue | StartDue | HeartbeatDue
Timer = ParticipantTimer | JoiningDue | ReportDue


class Activity(StrEnum):
    """What a device does for a participant."""

    QUOTE = "work out what it costs"
    PERFORM = "do it"
    HALT = "reach a safe state"
    UNDO = "undo it"


class WorkWanted(Struct, frozen=True, tag=True):
    """The device is to do that for the participant."""

    transaction: str
    participant: str
    activity: Activity


class ReportWanted(Struct, frozen=True, tag=True):
    """The person who runs the device is to be told something."""


Question = WorkWanted | ReportWanted
NodeTask = Quote | Perform | Halt | Undo | Report


class Equipped(Struct, frozen=True, tag=True):
    """The device is this one, in the system with this Repository and this Registry: told before every start."""

    profile: Profile
    repository: str
    registry: str


class Observed(Struct, frozen=True, tag=True):
    """The device noticed, outside of any contract, that the situation holds."""

    situation: str


class DepartureRequested(Struct, frozen=True, tag="Leave"):
    """The device is to take its leave."""


Notice = Equipped | Observed | DepartureRequested

"""The timers of a Service Manager, the questions that it asks its node, and the notices from the device's program."""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

from somrs.protocol.messages.observations import Observation
from somrs.service_manager.sdk.orders import Halt, Perform, Profile, Quote, Report, Undo


class TermsDue(Struct, frozen=True, tag=True):
    """The terms that were offered to the participant expire."""

    transaction: str
    participant: str


class StartDue(Struct, frozen=True, tag=True):
    """The time for the participant's order to start is over."""

    transaction: str
    participant: str


class HeartbeatDue(Struct, frozen=True, tag=True):
    """The participant at work has to send a heartbeat."""

    transaction: str
    participant: str


class JoiningDue(Struct, frozen=True, tag=True):
    """A step of joining has no answer, or the lease has to be renewed."""


class ReportDue(Struct, frozen=True, tag=True):
    """A report to the Repository has no answer."""


ParticipantTimer = TermsDue | StartDue | HeartbeatDue
Timer = ParticipantTimer | JoiningDue | ReportDue


class Activity(StrEnum):
    """The work that a device does for a participant."""

    QUOTE = "work out what it costs"
    PERFORM = "do it"
    HALT = "reach a safe state"
    UNDO = "undo it"


class WorkWanted(Struct, frozen=True, tag=True):
    """Work of the device for the participant."""

    transaction: str
    participant: str
    activity: Activity


class ReportWanted(Struct, frozen=True, tag=True):
    """A report to the person who runs the device."""


Question = WorkWanted | ReportWanted
NodeTask = Quote | Perform | Halt | Undo | Report


class Equipped(Struct, frozen=True, tag=True):
    """The profile of the device, and the addresses of its Repository and Registry; sent before every start.

    `other_registries`: those of the site at which it may publish instead.
    """

    profile: Profile
    repository: str
    registry: str
    other_registries: tuple[str, ...] = ()


class Observed(Struct, frozen=True, tag=True):
    """The device observed a situation outside of any contract."""

    situation: str | None
    observation: Observation | None = None


class ServicesChanged(Struct, frozen=True, tag=True):
    """The device has other services than when it joined; the profile has them."""

    profile: Profile


class DepartureRequested(Struct, frozen=True, tag="Leave"):
    """The device is to leave the system."""


Notice = Equipped | Observed | ServicesChanged | DepartureRequested

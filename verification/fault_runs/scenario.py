"""What happens in one run, as data: who is there, what is wanted, and what goes wrong. `draw.py` draws it from a seed."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import StrEnum

from somrs.ontology.services import Handler
from somrs.protocol.messages.clients import Policy
from somrs.runtime.virtual_time import KillPoint

AT_WORK = "the device at work"
"""The target of a fault: whichever device works at that moment, if any does."""


class Setting(StrEnum):
    """Which service types there are, and so how long the plans become."""

    FLAT = "things are put from anywhere to anywhere in one step"
    DOORS = "shelves stand behind doors, which others open and close"
    GRIP = "who takes a thing has to put it down, too"


class WorkFaultKind(StrEnum):
    """What goes wrong in a work."""

    SLOW = "takes fifteen times as long as it said"
    CARRY = "goes well, and tells of the thing on its way"
    DROP = "drops the thing, and says where it is"
    FAIL = "fails, and says nothing of what it left"
    ERROR = "runs into an error of its program"
    FALSE = "says it is done, and it is not"
    MISPUT = "puts the thing elsewhere, and says where"
    RAVE = "says it is done, and what the map cannot hold"
    HANG = "does not come to an end, and shows that it is alive"
    DIE = "breaks without a word"


class Undo(StrEnum):
    """What a device does to undo its work."""

    IMPOSSIBLE = "it cannot"
    RESTORE = "restores what was"
    FAIL = "fails, and says what is"
    HANG = "does not come to an end"


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceTraits:
    """A device. `joins` after so many seconds. `drops` what it holds when its program dies; `lays_down` what it holds when stopped."""

    name: str
    services: tuple[str, ...]
    price: int
    duration: float
    undo: Undo = Undo.IMPOSSIBLE
    refuses: bool = False
    mute: bool = False
    valid_for: float = 60.0
    halts: float = 1.0
    lease: float = 60.0
    joins: float = 0.0
    drops: bool = False
    lays_down: bool = True

    @property
    def address(self) -> str:
        return f"devices/{self.name}"


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskRequest:
    """A task. `task_manager` is the Task Manager that gets it; `cancelled`: so many seconds after it was taken; `previewed`: what it would
    cost is asked at the same time."""

    at: float
    task_manager: str
    effect: str
    deadline: float | None = None
    policy: Policy = Policy.PRICE
    handlers: tuple[Handler, ...] = ()
    cancelled: float | None = None
    priority: int = 0
    previewed: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Kill:
    """A component, or the device that is at work then, is killed at that moment, or at the next input after it, and comes back after
    so many seconds (None: never)."""

    at: float
    target: str
    moment: KillPoint = KillPoint.BETWEEN_INPUTS
    effects: int = 0
    seconds: float | None = 10.0
    snapshot: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """Nothing gets to it, or to the device that is at work then, or from it, for a while."""

    at: float
    target: str
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """For a while messages get lost or come twice, with these probabilities, and late by up to so many seconds."""

    at: float
    seconds: float
    lost: float
    twice: float
    late: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkFault:
    """The `nth` work (counted from 0) of the device, or of all devices together (None), goes wrong."""

    nth: int
    kind: WorkFaultKind
    device: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """A person puts a thing somewhere; `is_reported`: and tells the Repository."""

    at: float
    thing: str
    place: str
    is_reported: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Sight:
    """A camera sees how something is, and tells the Repository."""

    at: float
    object: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Departure:
    """A device takes its leave."""

    at: float
    device: str


Fault = Kill | Cut | Disturbance | WorkFault | Move | Sight | Departure


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """`planning`: seconds that the planner takes. `things` are on supports, `doors` are open or not, `shelves` stand behind them."""

    seed: int
    setting: Setting
    managers: int
    tables: tuple[str, ...]
    shelves: tuple[tuple[str, str], ...]
    doors: tuple[tuple[str, bool], ...]
    things: tuple[tuple[str, str], ...]
    devices: tuple[DeviceTraits, ...]
    requests: tuple[TaskRequest, ...]
    faults: tuple[Fault, ...]
    planning: float = 0.0

    def describe(self) -> str:
        """The story, to be read."""
        lines = [
            f"{self.setting}; {self.managers} Task Manager{'s' if self.managers > 1 else ''}, planning takes {self.planning:g} s",
            f"on tables {', '.join(self.tables)}; shelves {', '.join(f'{s} behind {d}' for s, d in self.shelves)}",
            f"doors: {', '.join(f'{door} open' if is_open else f'{door} closed' for door, is_open in self.doors)}",
            f"things: {', '.join(f'{thing} on {place}' for thing, place in self.things)}",
            "devices:",
            *(f"  {_describe(device)}" for device in self.devices),
            "tasks:",
            *(f"  {_describe(request)}" for request in self.requests),
            "what goes wrong:" if self.faults else "nothing goes wrong",
            *(f"  {_describe(fault)}" for fault in self.faults),
        ]
        return "\n".join(lines)


def _describe(value: DeviceTraits | TaskRequest | Fault) -> str:
    """A value with what is not as usual."""
    details = [f"{f.name}={_plain(getattr(value, f.name))}" for f in fields(value) if getattr(value, f.name) != f.default]
    return f"{type(value).__name__}: {', '.join(details)}"


def _plain(value: object) -> str:
    return str(value) if isinstance(value, StrEnum | str | float) else repr(value)

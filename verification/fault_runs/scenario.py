"""A run's scenario as data: devices, tasks and faults. `draw.py` draws one from a seed."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import StrEnum
from string import ascii_letters

from somrs.ontology.services import Handler
from somrs.protocol.messages.submission import Policy
from somrs.runtime.virtual_time import KillPoint

AT_WORK = "the device at work"
"""The target of a fault: the device that works at that moment, if there is one."""


MAPS = ("Barn", "Yard", "Mill")
"""The names of maps, if there are several."""


def floor_of(number: int) -> str:
    """The floor of the map with this number, from 0: the place of objects that were dropped."""
    return f"Floor{number + 1}"


class Setting(StrEnum):
    """The available service types, which determine the length of plans."""

    FLAT = "one step moves a thing from anywhere to anywhere"
    DOORS = "shelves are behind doors, which other devices open and close"
    GRIP = "the device that picks a thing up has to put it down"


class Store(StrEnum):
    """How it is known that a thing can be put on a shelf only if the door in front of it is open, by the service type."""

    PRECONDITION = "StoreObject"
    """The service type has it as a precondition."""
    CONDITION = "StoreFreely"
    """Only the devices know it: they state it as a condition of their terms, or when they refuse."""
    INVARIANT = "StoreThrough"
    """The service type says that the door has to stay open as long as the service runs."""


class Carry(StrEnum):
    """What has to be known before a thing is carried, by the service type."""

    PLAIN = "TransferObject"
    WEIGHED = "CarryParcel"
    """What it weighs: a robot carries only what its payload allows."""


class WorkFaultKind(StrEnum):
    """What goes wrong in one execution."""

    SLOW = "takes fifteen times as long as its terms say"
    CARRY = "succeeds, and reports the thing's position on the way"
    DROP = "drops the thing, and reports where it is"
    FAIL = "fails without a report of the situation"
    ERROR = "raises an error in its program"
    FALSE = "reports a completion that is false"
    MISPUT = "puts the thing elsewhere, and reports where"
    RAVE = "reports a completion that the map cannot represent"
    HANG = "does not end, but sends heartbeats"
    DIE = "breaks without a message"


class Undo(StrEnum):
    """How a device compensates."""

    IMPOSSIBLE = "cannot"
    RESTORE = "restores the earlier state"
    FAIL = "fails, and reports the situation"
    HANG = "does not end"


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceTraits:
    """A device. `joins`: seconds from the start. `mended_at`: seconds from then, until which it refuses for now. `drops` what it holds when
    its program dies; `lays_down` what it holds when stopped."""

    name: str
    services: tuple[str, ...]
    price: int
    duration: float
    undo: Undo = Undo.IMPOSSIBLE
    refuses: bool = False
    mute: bool = False
    mended_at: float = 0.0
    valid_for: float = 60.0
    halts: float = 1.0
    lease: float = 60.0
    joins: float = 0.0
    drops: bool = False
    lays_down: bool = True
    refuses_conditionally: bool = False
    """It refuses on a condition instead of stating one in its terms."""
    penalty: float | None = None
    """What it asks for undoing, in EUR."""
    payload: float = 5.0
    """In kg."""

    @property
    def address(self) -> str:
        return f"devices/{self.name}"


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskRequest:
    """A task for the Task Manager `task_manager`. `cancelled`: seconds from its acceptance; `previewed`: a preview is requested at the same
    time. `waits`: until its deadline, it is tried again when it cannot be done now."""

    at: float
    task_manager: str
    effect: str
    deadline: float | None = None
    policy: Policy = Policy.PRICE
    handlers: tuple[Handler, ...] = ()
    cancelled: float | None = None
    priority: int = 0
    previewed: bool = False
    waits: bool = False
    recognise: bool = False
    """It asks whether `effect` holds, instead of making it so."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kill:
    """A kill of a component, or of the device that works then, at that moment or at the next input after it. It restarts after `seconds`
    (None: never)."""

    at: float
    target: str
    moment: KillPoint = KillPoint.BETWEEN_INPUTS
    effects: int = 0
    seconds: float | None = 10.0
    snapshot: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """An interval in which no message reaches or leaves the target."""

    at: float
    target: str
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Partition:
    """An interval in which no message passes between two components, whichever of them sends it."""

    at: float
    one: str
    other: str
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TakeOver:
    """A component's host dies at that moment or at the next input after it, or only seems to: with `lingers`, the process goes on sending
    for so many seconds what it had sent before. After `seconds`, a standby on another host goes on as the same component."""

    at: float
    target: str
    moment: KillPoint = KillPoint.BETWEEN_INPUTS
    effects: int = 0
    seconds: float = 2.6
    lingers: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """An interval in which messages are lost or duplicated, with these probabilities, or delayed by up to `late` seconds."""

    at: float
    seconds: float
    lost: float
    twice: float
    late: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkFault:
    """A fault in the `nth` execution (from 0) of the device, or of all devices together (None)."""

    nth: int
    kind: WorkFaultKind
    device: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """A person moves a thing, and with `is_reported` tells the Repository."""

    at: float
    thing: str
    place: str
    is_reported: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Slam:
    """A person opens or shuts a door; a sensor reports it."""

    at: float
    door: str
    is_open: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Sight:
    """A camera reports an object's situation to the Repository."""

    at: float
    object: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """A camera sees a whole support. It reports what stands there by looks, not by name."""

    at: float
    place: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Loss:
    """A person does not find an object at its place, and marks it on the map as unknown."""

    at: float
    object: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Departure:
    """A device leaves in an orderly way."""

    at: float
    device: str


Fault = Kill | TakeOver | Cut | Partition | Disturbance | WorkFault | Move | Slam | Sight | Survey | Loss | Departure


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """A scenario. `planning`: seconds that the planner takes. `things` with their supports, `doors` open or not, `shelves` with doors.
    `repositories`: each has a map, and a Registry beside it; all are neighbours. Objects, devices and Task Managers are on the map of their
    number. `registries`: how many Registries the first map has; devices and Task Managers begin with one or another.

    `hidden`: things with their supports that the map does not have. `weights`: in kg, of each thing, if the map has none.
    """

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
    hidden: tuple[tuple[str, str], ...] = ()
    weights: tuple[tuple[str, float], ...] = ()
    registries: int = 1
    repositories: int = 1

    @property
    def maps(self) -> tuple[str, ...]:
        """The names of the maps. A single map has none."""
        return MAPS[: self.repositories] if self.repositories > 1 else ("",)

    @property
    def repository_addresses(self) -> list[str]:
        """In the order of the maps."""
        return ["repository", *(f"repository-{map}" for map in self.maps[1:])]

    def registry_addresses(self, map_number: int) -> list[str]:
        """The Registries at the map with this number."""
        count = self.registries if map_number == 0 else 1
        first = "registry" if map_number == 0 else f"registry-{self.maps[map_number]}"
        return [first, *(f"{first}-{number}" for number in range(2, count + 1))]

    def map_number(self, name: str) -> int:
        """The number, from 0, of the map that has a numbered object, device or Task Manager."""
        return (int(name.lstrip(ascii_letters)) - 1) % self.repositories

    @property
    def thing_type(self) -> str:
        return "Parcel" if self.weights else "Jar"

    def describe(self) -> str:
        """Return the scenario as text for people."""
        lines = [
            f"{self.setting}; {self.managers} Task Manager{'s' if self.managers > 1 else ''}, planning takes {self.planning:g} s",
            *([f"{self.repositories} Repositories: {', '.join(self.maps)}"] if self.repositories > 1 else []),
            *([f"{self.registries} Registries{' at the first' if self.repositories > 1 else ''}"] if self.registries > 1 else []),
            f"on tables {', '.join(self.tables)}; shelves {', '.join(f'{s} behind {d}' for s, d in self.shelves)}",
            f"doors: {', '.join(f'{door} open' if is_open else f'{door} closed' for door, is_open in self.doors)}",
            f"things: {', '.join(f'{thing} on {place}' for thing, place in self.things)}",
            *([f"not on the map: {', '.join(f'{thing} on {place}' for thing, place in self.hidden)}"] if self.hidden else []),
            *([f"weights: {', '.join(f'{thing} {weight:g} kg' for thing, weight in self.weights)}"] if self.weights else []),
            "devices:",
            *(f"  {_describe(device)}" for device in self.devices),
            "tasks:",
            *(f"  {_describe(request)}" for request in self.requests),
            "faults:" if self.faults else "no faults",
            *(f"  {_describe(fault)}" for fault in self.faults),
        ]
        return "\n".join(lines)


def _describe(value: DeviceTraits | TaskRequest | Fault) -> str:
    """Return a value's fields that differ from their defaults, as text."""
    details = [f"{f.name}={_plain(getattr(value, f.name))}" for f in fields(value) if getattr(value, f.name) != f.default]
    return f"{type(value).__name__}: {', '.join(details)}"


def _plain(value: object) -> str:
    return str(value) if isinstance(value, StrEnum | str | float) else repr(value)

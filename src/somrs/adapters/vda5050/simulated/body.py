"""The body of a simulated vehicle: what it can do and sense."""

from __future__ import annotations

import math
from typing import Protocol

from msgspec import Struct

from somrs.adapters.vda5050.messages.states import BoundingBoxReference, Load


class Sensed(Struct, frozen=True, kw_only=True):
    """How the body is. Lengths in metres, angles in radians on the vehicle's map; `charge`: 0 to 100.

    `finished`: the number of the last command that has ended, and `failure` why it failed; None: it did not. `fault`: why the body cannot
    move until somebody mends it; None: it can. `load`: what it carries, by its sensor; None: nothing. `reach`: how far before its middle it
    carries and drops that. `map_id`: the map on which the body is, for one that rides lifts; None: the one on which it was.
    """

    x: float
    y: float
    yaw: float
    charge: float
    is_moving: bool
    is_charging: bool
    finished: int = 0
    failure: str | None = None
    fault: str | None = None
    map_id: str | None = None
    load: str | None = None
    reach: float = 0.0

    def loads(self, name: str | None) -> tuple[Load, ...]:
        """The loads as states show them, of a vehicle that carries the thing with this name; None: nothing."""
        place = BoundingBoxReference(x=self.reach, y=0.0, z=0.0)
        return (Load(load_id=name, bounding_box_reference=place),) if name is not None else ()


class Drive(Struct, frozen=True, kw_only=True):
    """Drive through points in straight lines, stop at the last one, and turn to `yaw` there; None: any. `speed`: at most, in metres per
    second; None: as fast as it can."""

    points: tuple[tuple[float, float], ...]
    map_id: str
    speed: float | None = None
    backward: bool = False
    yaw: float | None = None


class Pick(Struct, frozen=True, kw_only=True):
    """Take a load from a station."""

    load: str
    station: str


class Drop(Struct, frozen=True, kw_only=True):
    """Put the load down at a station; without one, on the floor."""

    load: str
    station: str


class Charge(Struct, frozen=True):
    """Connect with the charger."""


class Rest(Struct, frozen=True):
    """Stop what is being done, and the charging."""


Command = Drive | Pick | Drop | Charge | Rest


class Body(Protocol):
    """A body carries out one command at a time; a new one takes the place of the one before."""

    def begin(self, number: int, command: Command) -> None:
        """Begin a command. Its number comes back in what is sensed, when it has ended."""

    def sense(self, now: float) -> Sensed:
        """How the body is now. `now`: in seconds, by a clock that only goes forward."""

    @property
    def is_reachable(self) -> bool:
        """Whether its radio works."""


HANDLING = 4.0
"""Seconds that the stand-in takes to pick or drop."""


class StandInBody:
    """A body that moves at a steady speed, turns at once, and always succeeds; for tests, and for vehicles without a simulated world."""

    def __init__(self, x: float = 0.0, y: float = 0.0, yaw: float = 0.0, *, speed: float = 1.0, charge: float = 80.0) -> None:
        self.x, self.y, self.yaw, self.speed, self.charge = x, y, yaw, speed, charge
        self.is_reachable = True
        self.map_id: str | None = None
        """The map to which a lift has taken the body; None: it stays on its own."""
        self.obstacle: str | None = None
        """What keeps the body from beginning anything; None: nothing."""
        self._now: float | None = None
        self._number = 0
        self._command: Command | None = None
        self._points: list[tuple[float, float]] = []
        self._ends_at = 0.0
        self._finished = 0
        self._failure: str | None = None
        self.load: str | None = None
        """What it carries."""

    def begin(self, number: int, command: Command) -> None:
        self._number, self._command, self._failure = number, command, None
        self._ends_at = (self._now or 0.0) + HANDLING
        self._points = list(command.points) if isinstance(command, Drive) else []

    def sense(self, now: float) -> Sensed:
        passed = now - self._now if self._now is not None else 0.0
        self._now = now
        self._advance(passed)
        return Sensed(
            x=self.x,
            y=self.y,
            yaw=self.yaw,
            charge=self.charge,
            is_moving=isinstance(self._command, Drive) and self.obstacle is None,
            is_charging=isinstance(self._command, Charge),
            finished=self._finished,
            failure=self._failure,
            load=self.load,
            map_id=self.map_id,
        )

    def _advance(self, passed: float) -> None:
        match self._command:
            case Drive(speed=speed, backward=backward):
                self._drive(passed * min(self.speed, speed or self.speed), backward)
            case Pick() | Drop() as work if self.obstacle is not None or (self._now or 0.0) >= self._ends_at:
                if self.obstacle is None:
                    self.load = work.load if isinstance(work, Pick) else None
                self._end(self.obstacle)
            case Charge():
                self._finished = self._number
                self.charge = min(100.0, self.charge + passed)
            case Rest():
                self._end(None)
            case None:
                return

    def _drive(self, length: float, backward: bool) -> None:
        if self.obstacle is not None:
            self._end(self.obstacle)
            return
        while self._points:
            x, y = self._points[0]
            distance = math.hypot(x - self.x, y - self.y)
            if distance > 0.0:
                self.yaw = math.remainder(math.atan2(y - self.y, x - self.x) + (math.pi if backward else 0.0), math.tau)
            if length < distance - 1e-9:
                self.x += (x - self.x) * length / distance
                self.y += (y - self.y) * length / distance
                return
            self.x, self.y, length = x, y, length - distance
            del self._points[0]
        if isinstance(self._command, Drive) and self._command.yaw is not None:
            self.yaw = self._command.yaw
        self._end(None)

    def _end(self, failure: str | None) -> None:
        self._finished, self._failure, self._command = self._number, failure, None

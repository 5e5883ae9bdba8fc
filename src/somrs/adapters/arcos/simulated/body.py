"""What the controller of a simulated Pioneer needs of a body, and a body that moves in a plane with round obstacles."""

from __future__ import annotations

import math
from typing import Protocol

from msgspec import Struct

SONAR_CONE = math.radians(15)
"""Half of the angle in which a sonar disc hears echoes, rad."""


class Place(Struct, frozen=True, kw_only=True):
    """Where a body is, in metres and radians on the map."""

    x: float
    y: float
    yaw: float


class Body(Protocol):
    """The wheels, the gripper and the senses of a robot."""

    @property
    def place(self) -> Place:
        """Where it is."""

    @property
    def contact(self) -> str | None:
        """Which of its bumpers touch something: `front`, `rear`, or None."""

    @property
    def is_blocked(self) -> bool:
        """Whether its wheels are driven and do not turn."""

    @property
    def charge(self) -> float:
        """The charge of its battery, from 0 to 1."""

    @property
    def has_charger(self) -> bool:
        """Whether it stands at a charger."""

    @property
    def has_thing(self) -> bool:
        """Whether something is between the paddles, or where they would close around it."""

    @property
    def is_holding(self) -> bool:
        """Whether it has gripped something."""

    @property
    def is_handling(self) -> bool:
        """Whether it is still gripping or releasing."""

    def drive(self, forward: float, turning: float) -> None:
        """Drive with these velocities, m/s and rad/s, until told otherwise."""

    def echo(self, x: float, y: float, heading: float) -> float:
        """The range that a sonar disc measures at this place of the body, in the direction `heading`, m; infinite: none."""

    def grip(self) -> None:
        """Close the paddles around what is between them."""

    def release(self) -> None:
        """Open the paddles."""

    def set_charging(self, is_charging: bool) -> None:
        """Take current from the charger, or not any more."""

    def advance(self, duration: float) -> None:
        """So many seconds pass."""


class Obstacle(Struct, frozen=True, kw_only=True):
    """A round obstacle, in metres."""

    x: float
    y: float
    radius: float


class PlaneBody:
    """A body in a plane with round obstacles, which stop it. A thing that it can grip is at a point."""

    radius = 0.25
    reach = 0.35
    """From its centre to the middle of the paddles, m."""
    is_handling = False
    grasp = 0.08
    """How far a thing may be from the middle of the paddles, m."""

    def __init__(self, place: Place, obstacles: tuple[Obstacle, ...] = ()) -> None:
        self.place = place
        self.obstacles = obstacles
        self.thing: tuple[float, float] | None = None
        self.charger: tuple[float, float] | None = None
        self.charge = 0.9
        self.pressed: str | None = None
        """A bumper that is pressed, wherever the body is."""
        self._contact: str | None = None
        self.is_blocked = False
        self.is_stuck = False
        """The wheels do not turn, whatever the motors do."""
        self._velocities = (0.0, 0.0)
        self.is_holding = False
        self.is_slippery = False
        """What it closes its paddles around slips out."""
        self._is_charging = False

    @property
    def contact(self) -> str | None:
        return self.pressed or self._contact

    @property
    def has_charger(self) -> bool:
        return self.charger is not None and math.dist(self.charger, (self.place.x, self.place.y)) < 0.2

    @property
    def has_thing(self) -> bool:
        return self.is_holding or (self.thing is not None and math.dist(self.thing, self._paddles()) < self.grasp)

    def drive(self, forward: float, turning: float) -> None:
        self._velocities = forward, turning

    def echo(self, x: float, y: float, heading: float) -> float:
        cosine, sine = math.cos(self.place.yaw), math.sin(self.place.yaw)
        start = self.place.x + x * cosine - y * sine, self.place.y + x * sine + y * cosine
        return min((echo_range(start, self.place.yaw + heading, obstacle) for obstacle in self.obstacles), default=math.inf)

    def grip(self) -> None:
        self.is_holding = self.has_thing and not self.is_slippery

    def release(self) -> None:
        if self.is_holding:
            self.thing = self._paddles()
        self.is_holding = False

    def set_charging(self, is_charging: bool) -> None:
        self._is_charging = is_charging

    def advance(self, duration: float) -> None:
        if self._is_charging and self.has_charger:
            self.charge = min(1.0, self.charge + duration / 60)
        forward, turning = self._velocities
        yaw = self.place.yaw + turning * duration
        middle = self.place.yaw + turning * duration / 2
        x = self.place.x + forward * duration * math.cos(middle)
        y = self.place.y + forward * duration * math.sin(middle)
        is_free = forward == 0 or self._distance(x, y) >= min(self.radius, self._distance(self.place.x, self.place.y))
        self.is_blocked = self.is_stuck or not is_free
        if not is_free:
            self._contact = "front" if forward > 0 else "rear"
        elif not self.is_blocked and forward != 0:
            self._contact = None
        if self.is_stuck:
            return
        self.place = Place(x=x, y=y, yaw=yaw) if is_free else Place(x=self.place.x, y=self.place.y, yaw=yaw)

    def _distance(self, x: float, y: float) -> float:
        """The distance to the nearest obstacle, m."""
        return min((math.dist((x, y), (obstacle.x, obstacle.y)) - obstacle.radius for obstacle in self.obstacles), default=math.inf)

    def _paddles(self) -> tuple[float, float]:
        return self.place.x + self.reach * math.cos(self.place.yaw), self.place.y + self.reach * math.sin(self.place.yaw)


def point_range(start: tuple[float, float], direction: float, point: tuple[float, float]) -> float:
    """The range of the echo of a point that a sonar disc hears, m; infinite if it hears none.

    A disc hears what is in a cone of `SONAR_CONE` to each side of its direction, and takes it for straight ahead.
    """
    dx, dy = point[0] - start[0], point[1] - start[1]
    aside = abs(math.remainder(math.atan2(dy, dx) - direction, 2 * math.pi))
    return math.hypot(dx, dy) if aside <= SONAR_CONE else math.inf


def echo_range(start: tuple[float, float], direction: float, obstacle: Obstacle) -> float:
    """The range of the echo of a round obstacle, as `point_range`."""
    dx, dy = obstacle.x - start[0], obstacle.y - start[1]
    distance = math.hypot(dx, dy)
    if distance <= obstacle.radius:
        return 0.0
    aside = abs(math.remainder(math.atan2(dy, dx) - direction, 2 * math.pi))
    if aside >= SONAR_CONE + math.asin(obstacle.radius / distance):
        return math.inf
    # The nearest point in the cone: towards the middle of the obstacle, or at the edge of the cone.
    bend = max(0.0, aside - SONAR_CONE)
    return distance * math.cos(bend) - math.sqrt(max(0.0, obstacle.radius**2 - (distance * math.sin(bend)) ** 2))

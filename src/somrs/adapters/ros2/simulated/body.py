"""What the nodes of a simulated robot need of its body, and a body that only moves, in real time."""

from __future__ import annotations

import asyncio
import math
from typing import Protocol

PERIOD = 0.02
"""Time between two steps of the kinematic body, s."""
REACH = 1.0
"""How far from the robot its gripper takes things, m."""


class BodyFailed(Exception):
    """The body could not do what it was told. `description`: why."""

    def __init__(self, description: str) -> None:
        self.description = description
        super().__init__(description)


class Body(Protocol):
    """The body of a robot. Poses are x, y and yaw on the robot's own map, in metres and radians."""

    @property
    def pose(self) -> tuple[float, float, float]: ...

    @property
    def moves(self) -> bool: ...

    @property
    def battery(self) -> float:
        """The charge of the battery, 0 to 1."""

    @property
    def holding(self) -> str | None:
        """What is in the gripper."""

    async def drive(self, x: float, y: float, yaw: float, speed: float | None) -> None:
        """Drive straight to a point, and turn. Raises BodyFailed; a cancelled drive goes on until `stop`, or another one."""

    async def stop(self) -> None:
        """Stand still."""

    async def take(self, thing: str | None) -> None:
        """Grip a thing; None: what is within reach. Raises BodyFailed."""

    async def put(self, support: str | None) -> None:
        """Release what is held, onto a support, or where the robot is. Raises BodyFailed."""

    async def charge(self) -> None:
        """Charge the battery until it is full, or until `stop`. Raises BodyFailed."""


class KinematicBody:
    """A body that drives in straight lines. `things`: where things are, by name."""

    def __init__(
        self,
        pose: tuple[float, float, float],
        things: dict[str, tuple[float, float]] | None = None,
        speed: float = 1.0,
        battery: float = 1.0,
    ) -> None:
        self.pose, self.speed, self.battery = pose, speed, battery
        self.things = dict(things or {})
        self.holding: str | None = None
        self._motion: asyncio.Task[None] | None = None
        self._is_charging = False

    @property
    def moves(self) -> bool:
        return self._motion is not None and not self._motion.done()

    async def drive(self, x: float, y: float, yaw: float, speed: float | None) -> None:
        await self.stop()
        self._motion = asyncio.create_task(self._drive(x, y, yaw, min(speed or self.speed, self.speed)))
        await asyncio.shield(self._motion)

    async def _drive(self, x: float, y: float, yaw: float, speed: float) -> None:
        while (distance := math.dist(self.pose[:2], (x, y))) > 0.0:
            step = min(distance, speed * PERIOD)
            direction = math.atan2(y - self.pose[1], x - self.pose[0])
            self.pose = (self.pose[0] + step * math.cos(direction), self.pose[1] + step * math.sin(direction), direction)
            if step == distance:
                break
            await asyncio.sleep(PERIOD)
        self.pose = (x, y, yaw)

    async def stop(self) -> None:
        self._is_charging = False
        if self._motion is not None:
            self._motion.cancel()

    async def take(self, thing: str | None) -> None:
        if self.holding is not None:
            raise BodyFailed(f"it holds {self.holding}")
        near = sorted((math.dist(self.pose[:2], place), name) for name, place in self.things.items() if thing in (None, name))
        if not near or near[0][0] > REACH:
            raise BodyFailed("nothing is within reach" if thing is None else f"{thing} is not within reach")
        self.holding = near[0][1]
        del self.things[self.holding]

    async def put(self, support: str | None) -> None:
        if self.holding is None:
            raise BodyFailed("it holds nothing")
        self.things[self.holding], self.holding = self.pose[:2], None

    async def charge(self) -> None:
        self._is_charging = True
        while self._is_charging and self.battery < 1.0:
            self.battery = min(1.0, self.battery + 0.1)
            await asyncio.sleep(PERIOD)

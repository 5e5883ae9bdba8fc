"""A driver and a simulated Pioneer robot, joined in virtual time."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

from somrs.adapters.arcos.driver import Driver
from somrs.adapters.arcos.events import (
    Action,
    ActionDone,
    ActionFailed,
    Broken,
    Connected,
    Disconnected,
    Effect,
    Follow,
    Halt,
    Halted,
    Heard,
    Input,
    Passed,
    Received,
    Tick,
    Transmit,
)
from somrs.adapters.arcos.odometry import Pose
from somrs.adapters.arcos.simulated.body import Obstacle, Place, PlaneBody
from somrs.adapters.arcos.simulated.firmware import Firmware, packet
from somrs.devices.road_robot import Way, Waypoint

STEP = 0.02
"""Seconds of virtual time between two steps of the controller."""

Line = Callable[[bytes], bytes]
"""What a line makes of bytes."""


def perfect(data: bytes) -> bytes:
    """A line that loses nothing."""
    return data


def damaged(data: bytes, chance: random.Random, share: float) -> bytes:
    """Bytes of which this share is lost, or has a wrong bit."""
    received = bytearray()
    for byte in data:
        draw = chance.random()
        if draw >= share / 2:
            received.append(byte ^ (1 << chance.randrange(8)) if draw < share else byte)
    return bytes(received)


def way(*points: tuple[float, float], released: int | None = None, start: int = 1, travel: str | None = None) -> Way:
    """A way through points, of which the first `released` are released (None: all); numbers begin with `start`."""
    return tuple(
        Waypoint(
            number=start + index,
            name=f"P{start + index}",
            x=x,
            y=y,
            level=0.0,
            released=released is None or index < released,
            travel=travel,
        )
        for index, (x, y) in enumerate(points)
    )


class Pioneer:
    """A simulated robot at a place of the map, and its driver, which knows that place."""

    def __init__(
        self,
        x: float = 0.0,
        y: float = 0.0,
        yaw: float = 0.0,
        *,
        subclass: str = "p3dx-sh",
        obstacles: tuple[Obstacle, ...] = (),
        slip: float = 0.0,
        gripper: bool = True,
        watchdog: float = 2.0,
    ) -> None:
        self.body = PlaneBody(Place(x=x, y=y, yaw=yaw), obstacles)
        self.firmware = Firmware(self.body, subclass=subclass, slip=slip, gripper=gripper, watchdog=watchdog)
        self.driver = Driver(Pose(x=x, y=y, yaw=yaw))
        self.now = 0.0
        self.effects: list[Effect] = []
        self.to_robot: Line = perfect
        self.from_robot: Line = perfect
        self.obeys: Callable[[bytes], bool] = lambda data: True
        """What of the bytes for it the controller does; what it does not, its watchdog hears nevertheless."""
        self.is_connected = False
        self.connect()

    def connect(self) -> None:
        self.is_connected = True
        self.give(Connected())

    def disconnect(self) -> None:
        self.is_connected = False
        self.give(Disconnected())

    def give(self, input: Input) -> None:
        """Give the driver an input, and carry its effects out."""
        for effect in self.driver.handle(input, self.now):
            if not isinstance(effect, Transmit):
                self.effects.append(effect)
            elif self.is_connected:
                self.firmware.receive(self.to_robot(effect.data if self.obeys(effect.data) else packet(b"\0")))

    def run(self, seconds: float, condition: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass, until the condition holds. Returns whether it does."""
        end = self.now + seconds
        while self.now < end and not condition():
            self.now += STEP
            data = self.firmware.step(STEP)
            if self.is_connected and data:
                self.give(Received(self.from_robot(data)))
            self.give(Tick())
        return condition()

    def ready(self) -> Pioneer:
        """Run until the robot is connected, with its motors on."""
        assert self.run(10, lambda: Heard(True) in self.effects and self.firmware._motors)
        return self

    def drive(self, way: Way, seconds: float = 120) -> bool:
        """Follow a way to its end. Returns whether the robot came there, and stands."""
        self.give(Follow(way))
        end = max(waypoint.number for waypoint in way if waypoint.released)
        return self.run(seconds, lambda: Passed(end) in self.effects and self.stands())

    def act(self, action: Action, seconds: float = 60) -> ActionDone | ActionFailed:
        """Have an action carried out."""
        self.effects.clear()
        self.give(action)
        assert self.run(seconds, lambda: self._end() is not None), "the action has come to no end"
        end = self._end()
        assert end is not None
        return end

    def halt(self) -> None:
        self.give(Halt())
        assert self.run(5, lambda: Halted() in self.effects)

    def stands(self) -> bool:
        return max(map(abs, self.firmware.velocity)) < 2

    def distance_to(self, x: float, y: float) -> float:
        """The true distance of the robot from a point, m."""
        return math.dist((self.body.place.x, self.body.place.y), (x, y))

    def _end(self) -> ActionDone | ActionFailed | None:
        return next((effect for effect in self.effects if isinstance(effect, ActionDone | ActionFailed)), None)


AHEAD = way((0.0, 0.0), (6.0, 0.0))


def under_way(pioneer: Pioneer | None = None) -> Pioneer:
    """A robot that drives at its full speed."""
    pioneer = (pioneer or Pioneer()).ready()
    pioneer.give(Follow(AHEAD))
    assert pioneer.run(20, lambda: pioneer.body.place.x > 1.0)
    return pioneer


def events(pioneer: Pioneer, *kinds: type[Effect]) -> list[Effect]:
    """Its effects of these kinds."""
    return [effect for effect in pioneer.effects if isinstance(effect, kinds)]


def stalled(pioneer: Pioneer) -> Broken:
    """Have the drive of a robot that drives break. Returns how it says so."""
    pioneer.body.is_stuck = True
    assert pioneer.run(6, lambda: bool(events(pioneer, Broken)))
    (broken,) = events(pioneer, Broken)
    assert isinstance(broken, Broken)
    return broken

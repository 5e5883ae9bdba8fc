"""Steering of a robot with two driven wheels: the velocities for a pose and a place to drive to. Pure functions.

The robot turns on the spot, drives along a line, and slows down so that it stands at the end. Velocities go out ten times a second, in
whole millimetres and degrees per second.
"""

from __future__ import annotations

import math

from msgspec import Struct

from somrs.adapters.arcos.odometry import Pose, wrap
from somrs.adapters.arcos.parameters import Parameters
from somrs.devices.road_robot import Motion

LOOK_AHEAD = 0.5
"""The robot steers to the point of the line this far ahead of it, m."""
DELAY = 0.2
"""Seconds for which a report and a command are on their way at most."""
ALLOWANCE = 0.1
"""How far a robot whose driver died may come past the end of what it may drive, m. Without it, it would never arrive."""
CREEPING = 0.05
"""Speed of the last centimetres, m/s."""
SLOWEST_TURN = math.radians(3)
"""Slower, the motors hardly turn, rad/s."""
BRAKING = 0.5
"""Share of the robot's deceleration that plans use: reports and commands are on their way for a tenth of a second."""
GRANTED = 2.0
"""How far ahead a robot may mostly drive, m: three places of the roadmap."""
HANDLING = 27.0
"""To turn to a thing, to drive up to it and back, and to move paddles and lift, for picking and for dropping, s."""


class Speeds(Struct, frozen=True, kw_only=True):
    """Velocities: m/s ahead, and rad/s counter-clockwise."""

    forward: float = 0.0
    turning: float = 0.0


STAND = Speeds()


def turn_speeds(error: float, parameters: Parameters) -> Speeds:
    """The velocities that turn the robot by `error`, rad, on the spot."""
    braking = math.sqrt(2 * BRAKING * parameters.turning_acceleration * abs(error))
    speed = min(parameters.turning, braking, 3.0 * abs(error))
    return Speeds(turning=math.copysign(max(SLOWEST_TURN, speed), error))


def speed_for(distance: float, parameters: Parameters, limit: float) -> float:
    """The speed at which the robot may be this far before a place at which it has to stand, m/s, at most `limit`.

    A robot that is told nothing more from now on drives on until its watchdog stops it, and brakes: it stands before the place then, or
    hardly past it.
    """
    if distance <= 0:
        return 0.0
    way, braking, blind_time = distance + ALLOWANCE, parameters.acceleration, parameters.watchdog + DELAY
    blind = braking * (math.sqrt(blind_time**2 + 2 * way / braking) - blind_time)
    return min(limit, parameters.speed, blind, max(CREEPING, math.sqrt(2 * BRAKING * braking * distance)))


def motion_of(parameters: Parameters) -> Motion:
    """How robots move by these speeds, for their quotes."""
    return Motion(
        speed=speed_for(GRANTED, parameters, parameters.speed),
        acceleration=2 * parameters.acceleration * BRAKING / (1 + BRAKING),  # it brakes more gently than it sets off
        turning=parameters.turning,
        settling=2 * DELAY + parameters.turning / parameters.turning_acceleration,
        handling=HANDLING,
    )


class Line(Struct, frozen=True, kw_only=True):
    """A straight line from `start` to `end`, points in metres. `backward`: the robot drives backwards along it."""

    start: tuple[float, float]
    end: tuple[float, float]
    backward: bool = False

    @property
    def length(self) -> float:
        return math.dist(self.start, self.end)

    @property
    def yaw(self) -> float:
        """The yaw of a robot on the line, rad."""
        direction = math.atan2(self.end[1] - self.start[1], self.end[0] - self.start[0])
        return wrap(direction + math.pi) if self.backward else direction

    def offset(self, pose: Pose) -> tuple[float, float]:
        """How far the end of the line is ahead of the pose, along the line, and the pose to the left of the line, m."""
        direction = math.atan2(self.end[1] - self.start[1], self.end[0] - self.start[0])
        dx, dy = self.end[0] - pose.x, self.end[1] - pose.y
        cosine, sine = math.cos(direction), math.sin(direction)
        return dx * cosine + dy * sine, dx * sine - dy * cosine

    def steering_error(self, pose: Pose) -> float:
        """By how much the robot would have to turn to look at the point of the line that it steers to, rad."""
        _, aside = self.offset(pose)
        bend = math.atan2(-aside, LOOK_AHEAD)
        return wrap(self.yaw + bend - pose.yaw)


def line_speeds(line: Line, pose: Pose, speed: float, parameters: Parameters) -> Speeds:
    """The velocities along a line, at most `speed`.

    Who looks elsewhere drives slower, and who drives fast turns slowly: a robot that is told nothing more leaves the line by a circle.
    """
    error, blind_time = line.steering_error(pose), parameters.watchdog + DELAY
    forward = min(speed, ALLOWANCE / (blind_time * max(abs(error), 0.01))) if abs(error) < math.pi / 4 else 0.0
    limit = min(parameters.turning, 2 * ALLOWANCE / (max(forward, CREEPING) * blind_time**2))
    turning = max(-limit, min(limit, 1.5 * error))
    return Speeds(forward=-forward if line.backward else forward, turning=turning)

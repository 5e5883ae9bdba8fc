"""Dead reckoning: from the travel that a robot's encoders count to its pose on the map."""

from __future__ import annotations

import math

from msgspec import Struct

from somrs.adapters.arcos.messages import Status
from somrs.adapters.arcos.parameters import Parameters

WRAP = 1 << 15
"""Travel is counted modulo this: older controllers send 15 bits, newer ones 16."""
LARGEST_STEP = 3.0
"""Travel between two reports, m, also if some were lost. No robot drives farther in the time of its watchdog."""
SMALL_STEP, SMALL_TURN = 0.3, math.radians(60)
"""Between two reports, m and rad, if none was lost."""
AT_ORIGIN = 0.02
"""Counters that are this near to 0, m and rad, may have begun anew."""


class Pose(Struct, frozen=True, kw_only=True):
    """A pose on the map, in metres and radians."""

    x: float
    y: float
    yaw: float

    def moved(self, distance: float) -> Pose:
        """The pose this far ahead, m."""
        return Pose(x=self.x + distance * math.cos(self.yaw), y=self.y + distance * math.sin(self.yaw), yaw=self.yaw)


def wrap(angle: float) -> float:
    """The angle between -pi and pi, rad."""
    return math.remainder(angle, 2 * math.pi)


class Odometry:
    """Follows the pose of a robot on the map, from the pose at which it began.

    It takes the differences of reports, so that it does not matter where the robot's counters began, when they wrap around, or that they
    begin anew: the robot is taken to stand then where it was last.
    """

    def __init__(self, pose: Pose) -> None:
        self.pose = pose
        self._counted: tuple[int, int, int] | None = None

    def update(self, status: Status, parameters: Parameters) -> Pose:
        """Take in a report, and return the pose."""
        counted = status.x, status.y, status.heading
        if self._counted is not None:
            dx, dy = (parameters.metres * _difference(new, old) for new, old in zip(counted[:2], self._counted[:2], strict=True))
            old_heading, new_heading = parameters.radians * self._counted[2], parameters.radians * status.heading
            is_small = math.hypot(dx, dy) < SMALL_STEP and abs(wrap(new_heading - old_heading)) < SMALL_TURN
            if is_small or (math.hypot(dx, dy) < LARGEST_STEP and not _is_at_origin(status, parameters)):
                self._move(dx, dy, old_heading, new_heading)
        self._counted = counted
        return self.pose

    def _move(self, dx: float, dy: float, old_heading: float, new_heading: float) -> None:
        turned = self.pose.yaw - old_heading
        self.pose = Pose(
            x=self.pose.x + dx * math.cos(turned) - dy * math.sin(turned),
            y=self.pose.y + dx * math.sin(turned) + dy * math.cos(turned),
            yaw=wrap(turned + new_heading),
        )


def _difference(new: int, old: int) -> int:
    return (new - old + WRAP // 2) % WRAP - WRAP // 2


def _is_at_origin(status: Status, parameters: Parameters) -> bool:
    travel = math.hypot(parameters.metres * _difference(status.x, 0), parameters.metres * _difference(status.y, 0))
    return travel < AT_ORIGIN and abs(wrap(parameters.radians * status.heading)) < AT_ORIGIN

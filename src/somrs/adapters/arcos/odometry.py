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
SAME = 0.01
"""Difference between two poses up to which they are the same, m and rad: maps have them rounded."""
AT_ORIGIN = 0.02
"""Counters that are this near to 0, m and rad, may have begun anew."""


class Pose(Struct, frozen=True, kw_only=True):
    """A pose on the map, in metres and radians."""

    x: float
    y: float
    yaw: float

    def is_near(self, pose: Pose) -> bool:
        """Whether it is the same pose, as far as maps tell."""
        return math.dist((self.x, self.y), (pose.x, pose.y)) < SAME and abs(wrap(self.yaw - pose.yaw)) < SAME

    def moved(self, distance: float) -> Pose:
        """The pose this far ahead, m."""
        return Pose(x=self.x + distance * math.cos(self.yaw), y=self.y + distance * math.sin(self.yaw), yaw=self.yaw)


class Reckoning(Struct, frozen=True, kw_only=True):
    """A pose, and what the encoders had counted there: enough to go on from it in the same session of the robot."""

    pose: Pose
    x: int
    y: int
    heading: int


def wrap(angle: float) -> float:
    """The angle between -pi and pi, rad."""
    return math.remainder(angle, 2 * math.pi)


class Odometry:
    """Follows the pose of a robot on the map, from the pose at which it began.

    It takes the differences of reports, so that it does not matter where the robot's counters began, when they wrap around, or that they
    begin anew: the robot is taken to stand then where it was last. A single report that does not fit is wrong, and is left out.
    """

    def __init__(self, pose: Pose) -> None:
        self.pose = pose
        self._counted: Status | Reckoning | None = None
        self._doubtful: Status | None = None

    @property
    def reckoning(self) -> Reckoning | None:
        """The pose, with what was counted there; None before the first report."""
        counted = self._counted
        return Reckoning(pose=self.pose, x=counted.x, y=counted.y, heading=counted.heading) if counted is not None else None

    def resume(self, reckoning: Reckoning) -> None:
        """Go on from where an earlier program of the robot was."""
        self.pose, self._counted = reckoning.pose, reckoning

    def update(self, status: Status, parameters: Parameters) -> Pose:
        """Take in a report, and return the pose."""
        if self._counted is None:
            self._counted = status
        step = _Step(self._counted, status, parameters)
        if step.is_small or (step.distance < LARGEST_STEP and not _is_at_origin(status, parameters)):
            self._move(step)
            self._counted, self._doubtful = status, None
        elif self._doubtful is not None and _Step(self._doubtful, status, parameters).is_small:
            self._counted, self._doubtful = status, None
        else:
            self._doubtful = status
        return self.pose

    def _move(self, step: _Step) -> None:
        turned = self.pose.yaw - step.old_heading
        self.pose = Pose(
            x=self.pose.x + step.dx * math.cos(turned) - step.dy * math.sin(turned),
            y=self.pose.y + step.dx * math.sin(turned) + step.dy * math.cos(turned),
            yaw=wrap(turned + step.new_heading),
        )


class _Step:
    """What the counters have changed between two reports, in metres and radians."""

    def __init__(self, old: Status | Reckoning, new: Status, parameters: Parameters) -> None:
        self.dx = parameters.metres * _difference(new.x, old.x)
        self.dy = parameters.metres * _difference(new.y, old.y)
        self.old_heading, self.new_heading = parameters.radians * old.heading, parameters.radians * new.heading
        self.distance = math.hypot(self.dx, self.dy)
        self.is_small = self.distance < SMALL_STEP and abs(wrap(self.new_heading - self.old_heading)) < SMALL_TURN


def _difference(new: int, old: int) -> int:
    return (new - old + WRAP // 2) % WRAP - WRAP // 2


def _is_at_origin(status: Status, parameters: Parameters) -> bool:
    travel = math.hypot(parameters.metres * _difference(status.x, 0), parameters.metres * _difference(status.y, 0))
    return travel < AT_ORIGIN and abs(wrap(parameters.radians * status.heading)) < AT_ORIGIN

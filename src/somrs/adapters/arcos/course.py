"""Follows the ways of a robot: which of its waypoints is next, and the velocities to it."""

from __future__ import annotations

import math

from somrs.adapters.arcos.obstacles import GAP, SonarMap
from somrs.adapters.arcos.odometry import Pose, wrap
from somrs.adapters.arcos.parameters import Parameters
from somrs.adapters.arcos.steering import ALLOWANCE, STAND, Line, Speeds, line_speeds, speed_for, turn_speeds
from somrs.devices.road_robot import Way, Waypoint

ALIGNED = math.radians(1.5)
"""A robot that has turned on the spot looks ahead with this error at most, rad."""
ASKEW = math.radians(20)
"""With a larger error, the robot stops and turns on the spot, rad."""
STILL = 0.02
"""Slower, the robot does not drive, and does not turn, m/s and rad/s."""
STRAIGHT = math.radians(15)
"""A robot drives through waypoints at which its way bends by less, rad."""
ARRIVED, ASIDE = 0.012, 0.04
"""How far ahead and aside the place may be at which a robot stops, m."""
SLOW = 0.06
"""Speed from which a robot that stops is still at the place, m/s."""
BACKING = 0.5
"""A robot that has driven past its place backs up as far, m, and turns around if it is farther."""
PASSED = 0.05
"""How far ahead a waypoint may be that the robot drives through, m."""
OFF_LINE = 0.3
"""A robot this far from its line drives straight to the next waypoint, m."""


class Course:
    """The way of a robot, and how far along it the robot is.

    `gap`: why the robot waits: how far ahead something is in its way, m; None if nothing is.
    """

    def __init__(self) -> None:
        self._way: Way = ()
        self._number: int | None = None
        self._stop_number: int | None = None
        """The waypoint at which the robot has stopped, and turns."""
        self._aligning = True
        self.gap: float | None = None

    def follow(self, way: Way) -> None:
        """Take a way, or another version of the one that the robot follows."""
        self._way = way
        if way and (self._number is None or self._number not in {waypoint.number for waypoint in way}):
            self._number, self._aligning = way[0].number, True

    def clear(self) -> None:
        self._way, self._number, self._stop_number, self.gap, self._aligning = (), None, None, None, True

    @property
    def is_complete(self) -> bool:
        """Whether the robot has come to the end of what was released."""
        return self._target() is None

    def steer(self, pose: Pose, motion: Speeds, sonar: SonarMap, parameters: Parameters, now: float) -> tuple[Speeds, tuple[int, ...]]:
        """The velocities for a pose, and the numbers of the waypoints that the robot has come to. `motion`: its velocities now."""
        numbers: list[int] = []
        self.gap = None
        while (target := self._target()) is not None:
            line = self._line(target, pose)
            if self._stop_number != target.number and not self._has_come(line, target, pose, abs(motion.forward)):
                return self._speeds(line, target, pose, motion, sonar, parameters, now), tuple(numbers)
            if (speeds := self._turn_at_stop(target, pose, motion, parameters)) is not None:
                return speeds, tuple(numbers)
            numbers.append(target.number)
            self._number = target.number
        return STAND, tuple(numbers)

    def _turn_at_stop(self, target: Waypoint, pose: Pose, motion: Speeds, parameters: Parameters) -> Speeds | None:
        """The velocities to the heading that the robot is to have where it stops; None if it has it."""
        if target.yaw is None or self._following(target) is not None:
            return None
        self._stop_number = target.number
        error = wrap(target.yaw - pose.yaw)
        if abs(error) > ALIGNED:
            return STAND if abs(motion.forward) > STILL else turn_speeds(error, parameters)
        return STAND if abs(motion.turning) > STILL else None

    def _speeds(
        self, line: Line, target: Waypoint, pose: Pose, motion: Speeds, sonar: SonarMap, parameters: Parameters, now: float
    ) -> Speeds:
        error = line.steering_error(pose)
        if abs(error) > ASKEW:
            self._aligning = True
        if self._aligning and abs(error) > ALIGNED:
            return STAND if abs(motion.forward) > STILL else turn_speeds(error, parameters)
        if self._aligning and abs(motion.turning) > STILL:
            # It may not have heard yet that it is to turn no more, and is not to drive in a circle.
            return STAND
        self._aligning = False
        distance = self._stopping_distance(line, target, pose)
        self.gap = sonar.gap(line, pose, distance, parameters.half_width, now)
        distance = max(distance, ARRIVED) if self.gap is None else self.gap - GAP
        if distance <= 0:
            return STAND
        limit = target.speed_limit if target.speed_limit is not None else parameters.speed
        return line_speeds(line, pose, speed_for(distance, parameters, limit), parameters)

    def _target(self) -> Waypoint | None:
        """The next waypoint, if it is released."""
        return next((waypoint for waypoint in self._way if waypoint.number == (self._number or 0) + 1 and waypoint.released), None)

    def _line(self, target: Waypoint, pose: Pose) -> Line:
        """The line to a waypoint from the one before, or from the robot if that is somewhere else, or past the waypoint."""
        start = next((waypoint for waypoint in self._way if waypoint.number == target.number - 1), target)
        line = _line_between(start, target)
        ahead, aside = line.offset(pose)
        if line.length < ARRIVED or abs(aside) > OFF_LINE or (ahead < ARRIVED and abs(aside) > ASIDE) or ahead < -ASIDE:
            return _line_from(pose, line)
        return line

    def _has_come(self, line: Line, target: Waypoint, pose: Pose, speed: float) -> bool:
        ahead, aside = line.offset(pose)
        following = self._straight_on(line, target)
        if following is not None:
            return ahead <= PASSED and abs(aside) <= OFF_LINE
        return ahead <= ARRIVED and math.hypot(ahead, aside) <= ASIDE and speed <= SLOW

    def _following(self, target: Waypoint) -> Waypoint | None:
        """The waypoint after another one, if it is released."""
        return next((waypoint for waypoint in self._way if waypoint.number == target.number + 1 and waypoint.released), None)

    def _straight_on(self, line: Line, target: Waypoint) -> Waypoint | None:
        """The waypoint after the next one, if the robot drives on to it without stopping."""
        following = self._following(target)
        if following is None:
            return None
        continuation = _line_between(target, following)
        is_straight = continuation.length < ARRIVED or abs(wrap(continuation.yaw - line.yaw)) < STRAIGHT
        return following if is_straight and continuation.backward == line.backward else None

    def _stopping_distance(self, line: Line, target: Waypoint, pose: Pose) -> float:
        """How far the robot drives before it has to stand, m; if it drove straight on at a bend, before it left its way."""
        distance, limit = line.offset(pose)[0], math.inf
        direction, end = line.yaw, line
        while (following := self._straight_on(end, target)) is not None:
            end, target = _line_between(target, following), following
            bend = abs(math.sin(wrap(end.yaw - direction))) if end.length else 0.0
            limit = min(limit, distance + ALLOWANCE / max(bend, 0.01))
            distance += end.length
        return min(distance, limit)


def _line_between(start: Waypoint, end: Waypoint) -> Line:
    return Line(start=(start.x, start.y), end=(end.x, end.y), backward=end.travel == "Backward")


def _line_from(pose: Pose, line: Line) -> Line:
    """The line from a pose to the end of another line."""
    direct = Line(start=(pose.x, pose.y), end=line.end, backward=line.backward)
    is_reversed = direct.length < BACKING and abs(wrap(direct.yaw - pose.yaw)) > math.pi / 2
    return Line(start=direct.start, end=direct.end, backward=line.backward != is_reversed)

"""How a robot with Nav2 follows its way, without I/O and clock: `handle(input) -> effects`.

Nav2 plans its own path to a goal, so that it only stays on the way if the way is straight: a goal is the last released waypoint that lies
in a straight line ahead. When more of that line is released, a new goal takes the place of the one before, without a stop.
"""

from __future__ import annotations

import math
from itertools import pairwise

from msgspec import Struct

from somrs.adapters.ros2.frames import Pose
from somrs.adapters.ros2.lines import GoalStatus
from somrs.devices.road_robot import Way, Waypoint
from somrs.space.lines import point_distance

STRAIGHT = 0.05
"""How far from a straight line the waypoints on it may be, m."""
SAME_LEVEL = 0.1
"""Difference in height up to which two waypoints are on the same floor, m."""


class WayChanged(Struct, frozen=True, tag=True):
    """The robot is to follow this way."""

    way: Way


class HaltWanted(Struct, frozen=True, tag=True):
    """The robot is to stand still."""


class PoseKnown(Struct, frozen=True, tag=True):
    """The robot is here, on the map of the building."""

    pose: Pose


class MotionKnown(Struct, frozen=True, tag=True):
    """Whether the robot moves, by its odometry."""

    moves: bool


class NavigatorPresent(Struct, frozen=True, tag=True):
    """Whether the robot's navigation can be reached. Whenever it appears, it has no goals."""

    present: bool


class NavigationEnded(Struct, frozen=True, tag=True):
    """The goal of this number has ended. `problem`: what the robot says about it."""

    goal: int
    status: GoalStatus
    problem: str = ""


class LevelEntered(Struct, frozen=True, tag=True):
    """The robot uses the map of the floor on which it is now; or does not, for this reason."""

    level: float
    problem: str | None = None


Input = WayChanged | HaltWanted | PoseKnown | MotionKnown | NavigatorPresent | NavigationEnded | LevelEntered


class Navigate(Struct, frozen=True, tag=True):
    """Send a goal, with a number of its own, which takes the place of an earlier one. `yaw`: in which the robot arrives."""

    goal: int
    waypoint: Waypoint
    yaw: float


class CancelNavigation(Struct, frozen=True, tag=True):
    """Cancel the goal of this number."""

    goal: int


class EnterLevel(Struct, frozen=True, tag=True):
    """Have the robot use the map of another floor, on which it is now. `LevelEntered` is the answer."""

    waypoint: Waypoint


class HasPassed(Struct, frozen=True, tag=True):
    """The robot has come to the waypoint of this number."""

    number: int


class HasGivenUp(Struct, frozen=True, tag=True):
    """The robot stands, and does not drive on along its way."""

    description: str


class HasHalted(Struct, frozen=True, tag=True):
    """The robot stands still, as it was to."""


Effect = Navigate | CancelNavigation | EnterLevel | HasPassed | HasGivenUp | HasHalted


class Driving:
    """The state of a robot that follows ways. `corridor`: how far from its way it may be, m; `level`: of the floor on which it is, m."""

    def __init__(self, name: str, corridor: float, level: float) -> None:
        self.name, self.corridor, self.level = name, corridor, level
        self.pose: Pose | None = None
        self._way: Way = ()
        """The released waypoints from the one that was passed last."""
        self._passed = -1
        self._goals = 0
        self._goal: Navigate | None = None
        """The goal of the robot, which it gets again if its navigation loses it."""
        self._open: set[int] = set()
        """The goals that have not ended: `_goal`, and those that it has replaced."""
        self._start: Pose | None = None
        """Where the robot was when it got its goal."""
        self._entering: Waypoint | None = None
        self._is_present = self._moves = False
        self._is_halting = False
        self._reason: str | None = None
        """Why the robot is to give up its way, as soon as it stands."""

    def handle(self, input: Input) -> list[Effect]:
        """Take what happened, and return what to do."""
        effects: list[Effect] = []
        match input:
            case WayChanged(way=way):
                self._take(way)
            case HaltWanted():
                self._is_halting = True
                effects += self._cancel()
            case PoseKnown(pose=pose):
                self.pose = pose
                effects += self._passing(pose) + self._straying(pose)
            case MotionKnown(moves=moves):
                self._moves = moves
            case NavigatorPresent(present=present):
                self._is_present = present
                if present:
                    self._goal = None
                    self._open.clear()
            case NavigationEnded(goal=goal):
                self._open.discard(goal)
                if self._goal is not None and goal == self._goal.goal:
                    effects += self._ended(self._goal, input)
            case LevelEntered(level=level, problem=problem) if self._entering is not None:
                effects += self._entered(self._entering, level, problem)
            case LevelEntered():
                pass
        return effects + self._go_on()

    def _take(self, way: Way) -> None:
        if not self._is_halting and self._reason is None:
            released = [waypoint for waypoint in way if waypoint.released]
            self._passed = max(self._passed, released[0].number) if released else self._passed
            self._way = tuple(waypoint for waypoint in released if waypoint.number >= self._passed)

    def _go_on(self) -> list[Effect]:
        """Send the next goal, or say that the robot stands, if it does."""
        if not self._is_present or self._entering is not None:
            return []
        if self._is_halting or self._reason is not None:
            return self._stand() if self._goal is None and not self._open and not self._moves else []
        if len(self._way) < 2:
            return []
        if abs(self._way[1].level - self.level) > SAME_LEVEL:
            if self._goal is not None:
                return []
            self._entering = self._way[1]
            return [EnterLevel(self._entering)]
        return self._aim(self._straight_ahead())

    def _stand(self) -> list[Effect]:
        effect: Effect = HasHalted() if self._is_halting else HasGivenUp(self._reason or "")
        self._way, self._is_halting, self._reason = (), False, None
        return [effect]

    def _aim(self, waypoint: Waypoint) -> list[Effect]:
        if self._goal is not None and self._goal.waypoint.number >= waypoint.number:
            return []
        line_start = self._way[0]
        yaw = math.atan2(waypoint.y - line_start.y, waypoint.x - line_start.x) + (math.pi if waypoint.travel == "Backward" else 0.0)
        yaw = waypoint.yaw if waypoint.yaw is not None else yaw
        self._goals += 1
        self._goal, self._start = Navigate(self._goals, waypoint, math.remainder(yaw, math.tau)), self.pose
        self._open.add(self._goal.goal)
        return [self._goal]

    def _straight_ahead(self) -> Waypoint:
        """The last waypoint that lies in a straight line ahead, on the same floor, with the same speed limit and direction of travel."""
        start, nearest = self._way[0], self._way[1]
        best = nearest
        for index in range(2, len(self._way)):
            waypoint = self._way[index]
            between = [(point.x, point.y) for point in self._way[:index]]
            line = (start.x, start.y), (waypoint.x, waypoint.y)
            lengths = [math.dist(line[0], point) for point in [*between, line[1]]]
            is_straight = all(point_distance(point, *line) <= STRAIGHT for point in between) and lengths == sorted(lengths)
            if not is_straight or abs(waypoint.level - nearest.level) > SAME_LEVEL:
                break
            if (waypoint.speed_limit, waypoint.travel) != (nearest.speed_limit, nearest.travel):
                break
            best = waypoint
        return best

    def _passing(self, pose: Pose) -> list[Effect]:
        """The waypoints before the goal that the robot has driven past."""
        effects: list[Effect] = []
        while self._goal is not None and len(self._way) > 2 and self._way[1].number < self._goal.waypoint.number:
            start, end = self._way[0], self._way[1]
            dx, dy = end.x - start.x, end.y - start.y
            if (pose.x - end.x) * dx + (pose.y - end.y) * dy < 0 or not self._is_on_way(pose):
                break
            effects += self._has_come_to(end)
        return effects

    def _straying(self, pose: Pose) -> list[Effect]:
        """Cancel the goal of a robot that has left its way: another may be there."""
        if self._goal is None or self._is_halting or self._reason is not None or self._is_on_way(pose):
            return []
        self._reason = f"{self.name} has left its way to {self._goal.waypoint.name} by more than {self.corridor:g} m, and was stopped"
        return self._cancel()

    def _is_on_way(self, pose: Pose) -> bool:
        assert self._goal is not None, "a robot without a goal is on no way"
        target = self._goal.waypoint
        lines = [((one.x, one.y), (two.x, two.y)) for one, two in pairwise(self._way) if two.number <= target.number]
        if self._start is not None:
            lines.append(((self._start.x, self._start.y), (target.x, target.y)))
        return not lines or any(point_distance((pose.x, pose.y), *line) <= self.corridor for line in lines)

    def _cancel(self) -> list[Effect]:
        return [CancelNavigation(goal) for goal in sorted(self._open)]

    def _ended(self, goal: Navigate, end: NavigationEnded) -> list[Effect]:
        if end.status == GoalStatus.LOST:
            # The navigation is away. When it is back, it has no goals, and gets this one again.
            return []
        self._goal = None
        if end.status == GoalStatus.SUCCEEDED:
            effects: list[Effect] = []
            while len(self._way) > 1 and self._way[1].number <= goal.waypoint.number:
                effects += self._has_come_to(self._way[1])
            return effects
        if not self._is_halting and self._reason is None:
            about = f": {end.problem}" if end.problem else ""
            self._reason = f"the navigation of {self.name} {end.status} the goal {goal.waypoint.name}{about}"
        return self._cancel()

    def _entered(self, waypoint: Waypoint, level: float, problem: str | None) -> list[Effect]:
        self._entering = None
        if problem is None:
            self.level = level
            return self._has_come_to(waypoint) if len(self._way) > 1 and self._way[1].number == waypoint.number else []
        self._reason = problem
        return []

    def _has_come_to(self, waypoint: Waypoint) -> list[Effect]:
        self._passed, self._way = waypoint.number, self._way[1:]
        return [HasPassed(waypoint.number)]

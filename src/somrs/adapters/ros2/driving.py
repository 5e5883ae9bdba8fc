"""How a robot with Nav2 follows its way, without I/O and clock: `handle(input) -> effects`.

Nav2 plans its own path to a pose, so that it only stays on the way if the way is straight: a goal is the last released waypoint that lies
in a straight line ahead. A goal that has all waypoints leads around corners, too. When more is released, a new goal takes the place of the
one before, without a stop.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from msgspec import Struct

from somrs.adapters.ros2.frames import Pose
from somrs.adapters.ros2.lines import GoalStatus
from somrs.devices.road_robot import Way, Waypoint
from somrs.space.lines import point_distance

STRAIGHT = 0.05
"""How far from a straight line the waypoints on it may be, m."""
REJECTIONS = 10
"""How often a goal is rejected until the trip fails: a navigation that starts rejects goals for some seconds."""
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


class GoalUnderWay(Struct, frozen=True, tag=True):
    """The robot says how far it has come to its goal."""


class RetryDue(Struct, frozen=True, tag=True):
    """A goal may be sent again that was rejected."""


class CancelRefused(Struct, frozen=True, tag=True):
    """The robot does not cancel the goal of this number, and goes on with it."""

    goal: int


class Disabled(Struct, frozen=True, tag=True):
    """Whether the robot is not to drive: it has a fault, or does not know where it is. Its way ends then."""

    is_disabled: bool


class LevelEntered(Struct, frozen=True, tag=True):
    """The robot uses the map of the floor on which it is now; or does not, for this reason."""

    level: float
    problem: str | None = None


Input = (
    WayChanged
    | HaltWanted
    | PoseKnown
    | MotionKnown
    | NavigatorPresent
    | NavigationEnded
    | GoalUnderWay
    | RetryDue
    | CancelRefused
    | Disabled
    | LevelEntered
)


class Navigate(Struct, frozen=True, tag=True):
    """Send a goal, with a number of its own, which takes the place of an earlier one. `start`: from where the lines lead through `way`,
    which ends where the robot is to stop; `yaws`: its headings there."""

    goal: int
    start: Waypoint
    way: Way
    yaws: tuple[float, ...]

    @property
    def waypoint(self) -> Waypoint:
        """Where the robot is to stop."""
        return self.way[-1]


class CancelNavigation(Struct, frozen=True, tag=True):
    """Cancel the goal of this number."""

    goal: int


class RetryLater(Struct, frozen=True, tag=True):
    """Wait a little. `RetryDue` is the answer."""


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


class DoesNotHeed(Struct, frozen=True, tag=True):
    """The robot does not do what it is told, as this description says; None: it does again."""

    description: str | None


Effect = Navigate | CancelNavigation | RetryLater | EnterLevel | HasPassed | HasGivenUp | HasHalted | DoesNotHeed


class Driving:
    """The state of a robot that follows ways. `corridor`: how far from its way it may be, m; `level`: of the floor on which it is, m;
    `turns`: whether a goal leads around corners."""

    def __init__(self, name: str, corridor: float, level: float, *, turns: bool = False) -> None:
        self.name, self.corridor, self.level, self.turns = name, corridor, level, turns
        self.pose: Pose | None = None
        self._way: Way = ()
        """The released waypoints from the one that was passed last."""
        self._passed = -1
        self._goals = 0
        self._goal: Navigate | None = None
        """The goal of the robot, which it gets again if its navigation loses it."""
        self._open: dict[int, Waypoint] = {}
        """The goals that have not ended, with where they end: `_goal`, and those that it has replaced."""
        self._refused: set[int] = set()
        """Those that the robot does not cancel."""
        self._rejections = 0
        """How often the goal has been rejected."""
        self._waits = False
        """Whether it is sent again only after a pause."""
        self._start: Pose | None = None
        """Where the robot was when it got its goal."""
        self._entering: Waypoint | None = None
        self._is_present = self._moves = False
        self._is_halting = self._is_disabled = False
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
            case GoalUnderWay():
                effects += self._no_longer_rejected()
            case RetryDue():
                self._waits = False
            case NavigatorPresent(present=present):
                self._is_present = present
                if present:
                    self._goal = None
                    self._open.clear()
                    effects += self._no_longer_refused(*self._refused) + self._no_longer_rejected()
            case CancelRefused(goal=goal) if goal in self._open and goal not in self._refused:
                self._refused.add(goal)
                place = self._open[goal].name
                effects.append(DoesNotHeed(f"{self.name} does not stop: it does not cancel its goal {place}, and is expected there"))
            case Disabled(is_disabled=is_disabled):
                self._is_disabled = is_disabled
                if is_disabled:
                    self._way, self._goal = (), None
                    effects += self._cancel()
            case NavigationEnded(goal=goal):
                self._open.pop(goal, None)
                effects += self._no_longer_refused(goal)
                if self._goal is not None and goal == self._goal.goal:
                    effects += self._ended(self._goal, input)
            case LevelEntered(level=level, problem=problem) if self._entering is not None:
                effects += self._entered(self._entering, level, problem)
            case _:
                pass
        return effects + self._go_on()

    def _no_longer_refused(self, *goals: int) -> list[Effect]:
        was_refused = bool(self._refused)
        self._refused.difference_update(goals)
        return [DoesNotHeed(None)] if was_refused and not self._refused else []

    def _no_longer_rejected(self) -> list[Effect]:
        was_rejected, self._rejections = self._rejections > 0, 0
        return [DoesNotHeed(None)] if was_rejected else []

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
        if len(self._way) < 2 or self._is_disabled or self._waits:
            return []
        if abs(self._way[1].level - self.level) > SAME_LEVEL:
            if self._goal is not None:
                return []
            self._entering = self._way[1]
            return [EnterLevel(self._entering)]
        return self._aim(self._ahead())

    def _stand(self) -> list[Effect]:
        effect: Effect = HasHalted() if self._is_halting else HasGivenUp(self._reason or "")
        self._way, self._is_halting, self._reason = (), False, None
        return [*self._no_longer_rejected(), effect]

    def _aim(self, ahead: Way) -> list[Effect]:
        if self._goal is not None and self._goal.waypoint.number >= ahead[-1].number:
            return []
        yaws: list[float] = []
        for start, end in pairwise((self._way[0], *ahead)) if self.turns else [(self._way[0], ahead[-1])]:
            yaw = math.atan2(end.y - start.y, end.x - start.x) + (math.pi if end.travel == "Backward" else 0.0)
            yaws.append(math.remainder(end.yaw if end.yaw is not None else yaw, math.tau))
        self._goals += 1
        self._goal = Navigate(self._goals, self._way[0], ahead if self.turns else ahead[-1:], tuple(yaws))
        self._start = self.pose
        self._open[self._goal.goal] = self._goal.waypoint
        return [self._goal]

    def _ahead(self) -> Way:
        """The waypoints ahead to which one goal leads: on the same floor, with the same speed limit and direction of travel, and in a
        straight line unless a goal leads around corners."""
        start, nearest = self._way[0], self._way[1]
        ahead = [nearest]
        for waypoint in self._way[2:]:
            if (waypoint.speed_limit, waypoint.travel) != (nearest.speed_limit, nearest.travel):
                break
            if abs(waypoint.level - nearest.level) > SAME_LEVEL or not (self.turns or _is_straight(start, ahead, waypoint)):
                break
            ahead.append(waypoint)
        return tuple(ahead)

    def _passing(self, pose: Pose) -> list[Effect]:
        """The waypoints before the goal that the robot has driven past."""
        effects: list[Effect] = []
        while self._goal is not None and len(self._way) > 2 and self._way[1].number < self._goal.waypoint.number:
            if not self._is_on_way(pose) or not _is_past(pose, *self._way[:3]):
                break
            effects += self._has_come_to(self._way[1])
        return effects

    def _straying(self, pose: Pose) -> list[Effect]:
        """Cancel the goal of a robot that has left its way: another may be there."""
        if self._goal is None or self._is_halting or self._reason is not None or self._is_on_way(pose):
            return []
        self._reason = f"{self.name} has left its way to {self._goal.waypoint.name} by more than {self.corridor:g} m, and was stopped"
        return self._cancel()

    def _is_on_way(self, pose: Pose) -> bool:
        assert self._goal is not None, "a robot without a goal is on no way"
        target, nearest = self._goal.waypoint, self._goal.way[0]
        lines = [((one.x, one.y), (two.x, two.y)) for one, two in pairwise(self._way) if two.number <= target.number]
        if self._start is not None:
            lines.append(((self._start.x, self._start.y), (nearest.x, nearest.y)))
        return not lines or any(point_distance((pose.x, pose.y), *line) <= self.corridor for line in lines)

    def _cancel(self) -> list[Effect]:
        return [CancelNavigation(goal) for goal in sorted(self._open)]

    def _ended(self, goal: Navigate, end: NavigationEnded) -> list[Effect]:
        if end.status == GoalStatus.LOST:
            # The navigation is away. When it is back, it has no goals, and gets this one again.
            return []
        self._goal = None
        is_wanted = not self._is_halting and self._reason is None
        if end.status == GoalStatus.REJECTED and not end.problem and is_wanted and self._rejections < REJECTIONS:
            return self._rejected(goal)
        if end.status == GoalStatus.SUCCEEDED:
            effects = self._no_longer_rejected()
            while len(self._way) > 1 and self._way[1].number <= goal.waypoint.number:
                effects += self._has_come_to(self._way[1])
            return effects
        if is_wanted:
            about = f": {end.problem}" if end.problem else ""
            self._reason = f"the navigation of {self.name} {end.status} the goal {goal.waypoint.name}{about}"
        return self._cancel()

    def _rejected(self, goal: Navigate) -> list[Effect]:
        """Send a goal again after a pause, of which the robot does not say what is wrong with it."""
        self._rejections, was_waiting, self._waits = self._rejections + 1, self._waits, True
        place = goal.waypoint.mark or goal.waypoint.name
        remark = DoesNotHeed(f"the navigation of {self.name} rejects its goal {place}; it is asked again")
        return [remark, *self._cancel(), *([] if was_waiting else [RetryLater()])]

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


def _is_straight(start: Waypoint, between: Sequence[Waypoint], end: Waypoint) -> bool:
    """Whether waypoints lie on the line from one to another, one after the other."""
    line = (start.x, start.y), (end.x, end.y)
    points = [(waypoint.x, waypoint.y) for waypoint in between]
    lengths = [math.dist(line[0], point) for point in [*points, line[1]]]
    return all(point_distance(point, *line) <= STRAIGHT for point in points) and lengths == sorted(lengths)


def _is_past(pose: Pose, start: Waypoint, end: Waypoint, following: Waypoint) -> bool:
    """Whether a robot has driven past the end of a line; at a corner that it cuts, whether it is nearer to the line that follows."""
    point, corner = (pose.x, pose.y), (end.x, end.y)
    if (pose.x - end.x) * (end.x - start.x) + (pose.y - end.y) * (end.y - start.y) >= 0:
        return True
    is_ahead = (pose.x - end.x) * (following.x - end.x) + (pose.y - end.y) * (following.y - end.y) > 0
    return is_ahead and point_distance(point, corner, (following.x, following.y)) < point_distance(point, (start.x, start.y), corner)

"""What is believed of where a robot is: whether it can be where it says that it is, has come to, or is kept a place for.

Without I/O and clock. The surroundings are asked for only when a pose is far from the one before.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise

from somrs.devices.road.waypoints import Waypoint
from somrs.space.lines import point_distance
from somrs.space.shafts import SAME_FLOOR
from somrs.space.solids import Point

JUMP = 1.0
"""How far a localisation corrects itself at once, at most, m."""
STILLNESS = 0.01
"""How far a robot that stands seems to move, m."""
DISPLACED = 0.3
"""A robot that stands farther from the place that it holds does not stand there, m: Nav2's goals end within 0.25 m."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What is around a robot. `is_driving`: it has somewhere to go. `is_free`: whether it can stand at a point of its floor."""

    is_driving: bool
    is_free: Callable[[Point], bool]


class Whereabouts:
    """Those of one robot."""

    def __init__(self) -> None:
        self.point: Point | None = None
        """Where it is, as far as is believed, m."""
        self.level: float | None = None
        """The height of its floor, m."""
        self._lost: str | None = None
        self._doubt: str | None = None
        self._is_to_be_confirmed = False
        self._rest_point: Point | None = None
        self.rest_time = math.inf
        """Since when it stands there, s; infinite until it is seen."""

    @property
    def problem(self) -> str | None:
        """Why nobody knows where the robot is; None if it is where it was seen last."""
        return self._lost or self._doubt

    def take(self, point: Point, level: float, now: float, surroundings: Surroundings) -> bool:
        """Whether the robot is believed when it says at a time, in seconds, that it is at a point of the floor at a height."""
        if self.point is not None and self.level is not None and abs(level - self.level) < SAME_FLOOR:
            self._doubt = self._doubt_about(point, self.point, surroundings)
        if self._doubt is not None:
            return False
        self.point, self.level = point, level
        if self._rest_point is None or max(abs(point[0] - self._rest_point[0]), abs(point[1] - self._rest_point[1])) > STILLNESS:
            self._rest_point, self.rest_time = point, now
        return True

    def _doubt_about(self, point: Point, earlier: Point, surroundings: Surroundings) -> str | None:
        """Why the robot is not believed to be at a point. How long it took does not count: reports may be late, and come all at once."""
        if math.dist(point, earlier) <= JUMP:
            return None
        if self._doubt is not None and self._is_to_be_confirmed:
            return self._doubt
        if surroundings.is_free(point):
            return None
        self._is_to_be_confirmed = surroundings.is_driving
        start, end = (f"({x:.2f}, {y:.2f})" for x, y in (earlier, point))
        doubt = f"its pose is {end}, where nothing can stand; it was at {start}"
        return f"{doubt}. If it is there, stop and release the robot" if self._is_to_be_confirmed else doubt

    def lose(self, reason: str | None) -> None:
        """The robot says that it does not know where it is, for this reason; None: it knows, and says it next."""
        self._lost, self._rest_point, self.rest_time = reason, None, math.inf

    def confirm(self) -> None:
        """Somebody has seen to it: the robot is where it says next."""
        if self._doubt is not None:
            self._doubt = self.point = None

    def is_off(self, way: Iterable[Waypoint], distance: float) -> bool:
        """Whether the robot is farther than a distance, in m, from the lines through the waypoints on its floor; not if there are none."""
        point, level = self.point, self.level
        waypoints = [waypoint for waypoint in way if level is not None and abs(waypoint.level - level) < SAME_FLOOR]
        if point is None or not waypoints:
            return False
        lines = [((start.x, start.y), (end.x, end.y)) for start, end in pairwise([*waypoints[:1], *waypoints])]
        return all(point_distance(point, *line) > distance for line in lines)

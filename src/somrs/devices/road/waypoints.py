"""The ways that robots of any make are told to follow."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise

from msgspec import Struct, structs

from somrs.space.shafts import SAME_FLOOR
from somrs.space.zones import Zones

STEP = 0.1
"""Distance between the points of a line at which it is looked at whether it is in a slow zone, m."""


class Waypoint(Struct, frozen=True, kw_only=True):
    """A place on the way of a robot, which drives there from the one before in a straight line.

    `number`: grows by one from waypoint to waypoint, for as long as the program runs, so that a place that is visited twice has two
    numbers; ways that follow each other share the numbers of the waypoints that they share. `name`: that of the place in traffic. `mark`:
    the Place of the map that is there, by its name; empty: there is none. `x`, `y`: in metres on the map. `level`: the height of its floor,
    in metres. `released`: the robot may drive there; others are planned, and can change. `speed_limit`: on the way there, of the lane and
    of the slow zones that it crosses, in metres per second; None: as fast as the robot may. `travel`: `Forward` or `Backward`, if the robot
    may not choose. `yaw`: the heading that it is to have there, in radians, if it stops there; None: any.
    """

    number: int
    name: str
    x: float
    y: float
    level: float
    released: bool
    speed_limit: float | None = None
    travel: str | None = None
    yaw: float | None = None
    mark: str = ""


Way = tuple[Waypoint, ...]
"""Waypoints with consecutive numbers. The first is the one that the robot has passed last, or at which it stands: it is always released."""


def with_slow_zones(way: Iterable[Waypoint], zones: Zones) -> Way:
    """A way on which robots drive slowly from waypoint to waypoint if there is a slow zone between them."""
    waypoints = [*way]
    if not zones.slow:
        return tuple(waypoints)
    slowed = [structs.replace(end, speed_limit=_speed_limit(start, end, zones)) for start, end in pairwise(waypoints)]
    return (*waypoints[:1], *slowed)


def _speed_limit(start: Waypoint, end: Waypoint, zones: Zones) -> float | None:
    """The highest speed from a waypoint to the next one, m/s; None: any."""
    count = max(1, math.ceil(math.dist((start.x, start.y), (end.x, end.y)) / STEP))
    shares = [index / count for index in range(count + 1)]
    points = [(start.x + share * (end.x - start.x), start.y + share * (end.y - start.y)) for share in shares]
    limits = [
        highest
        for area, highest in zones.slow
        if abs(area.z - end.level) < SAME_FLOOR and any(area.distance(*point) <= 0.0 for point in points)
    ]
    return min((*limits, *([end.speed_limit] if end.speed_limit is not None else [])), default=None)

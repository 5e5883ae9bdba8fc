"""Which doors a robot drives through: those that it would touch on a straight line."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from somrs.space.shafts import SAME_FLOOR
from somrs.space.solids import Point, Solid

DOOR_ROOM = 0.1
"""How far a robot stays away from a door that may move, m."""
STEP = 0.05
"""Distance between the points of a line that are looked at, m."""


def doors_between(doors: Iterable[Solid], level: float, start: Point, end: Point, radius: float) -> Iterator[str]:
    """The doors, by name, on the floor of a height in whose way a robot of this radius would be somewhere on a line."""
    span, reach = math.dist(start, end), radius + DOOR_ROOM
    steps = max(1, math.ceil(span / STEP))
    for door in doors:
        if abs(door.z - level) < SAME_FLOOR and math.dist((door.x, door.y), start) < door.extent + span + reach:
            shares = (step / steps for step in range(steps + 1))
            points = ((start[0] + (end[0] - start[0]) * share, start[1] + (end[1] - start[1]) * share) for share in shares)
            if any(door.distance(*point) < reach for point in points):
                yield door.name

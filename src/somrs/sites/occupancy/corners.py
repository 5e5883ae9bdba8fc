"""Lets walls meet in corners that nobody has seen, because something stands before them.

Coordinates are the grid's own, in metres.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from somrs.sites.occupancy.grid import Cell, OccupancyGrid
from somrs.sites.plan import Box, Point

_LONGEST = 4.0
"""The longest part of a wall that is hidden up to its corner, or where it bends, m."""
_MEETING = 0.15
"""A wall that is so near to the end of another one meets it, m."""
_STEEPEST = math.sin(math.radians(20))
"""Sine of the smallest angle at which walls meet."""
_FREE = 0.1
"""Share of cells that may be free where a wall goes on without having been seen."""


def with_corners(walls: Sequence[Box], grid: OccupancyGrid) -> list[Box]:
    """The walls. One that ends where nothing is known of what follows goes on up to another wall, or up to where both meet."""
    result = [*walls]
    for _, first, second in sorted(_meetings(result, grid)):
        corner = _crossing(result[first], result[second])
        if corner is not None and all(_may_reach(index, corner, result, grid) for index in (first, second)):
            result[first], result[second] = (_extended(result[index], corner) for index in (first, second))
    return [*result, *_bends(result, grid)]


def _bends(walls: Sequence[Box], grid: OccupancyGrid) -> Iterator[Box]:
    """The walls between the ends of two that go on in nearly the same direction, and of which nothing is known in between."""
    for first, wall in enumerate(walls):
        for second in range(first + 1, len(walls)):
            partner = walls[second]
            if math.dist((wall.x, wall.y), (partner.x, partner.y)) > wall.reach + partner.reach + _LONGEST:
                continue
            bend = gap_between(wall, partner)
            if not 2 * grid.resolution < bend.width <= _LONGEST or not (goes_on(wall, bend) and goes_on(partner, bend)):
                continue
            beside = [box for number, box in enumerate(walls) if number not in (first, second)]
            if any(box.gap(end) <= _MEETING for box in beside for end in _ends(bend)):
                continue
            points = [
                bend.world((float(u), 0.0)) for u in np.arange((grid.resolution - bend.width) / 2, bend.width / 2, grid.resolution / 2)
            ]
            if float(np.mean(grid.state_at(np.array(points)) == Cell.FREE)) <= _FREE:
                yield bend


def gap_between(wall: Box, partner: Box) -> Box:
    """The rectangle between the ends of two walls that are nearest to each other, as thick as the thinner one."""
    start, end = min(product(_ends(wall), _ends(partner)), key=lambda pair: math.dist(*pair))
    yaw = math.atan2(end[1] - start[1], end[0] - start[0])
    return Box((start[0] + end[0]) / 2, (start[1] + end[1]) / 2, math.dist(start, end), min(wall.depth, partner.depth), yaw)


def goes_on(wall: Box, gap: Box) -> bool:
    """Whether a gap is beyond the end of a wall, in nearly the same direction."""
    return abs(math.sin(wall.yaw - gap.yaw)) < _STEEPEST and abs(wall.local((gap.x, gap.y))[0]) > wall.width / 2


def _ends(wall: Box) -> tuple[Point, Point]:
    return wall.world((-wall.width / 2, 0.0)), wall.world((wall.width / 2, 0.0))


def _meetings(walls: Sequence[Box], grid: OccupancyGrid) -> Iterator[tuple[float, int, int]]:
    """The pairs of walls that may meet beyond their ends, with how much longer they get."""
    for first, wall in enumerate(walls):
        for second in range(first + 1, len(walls)):
            partner = walls[second]
            if math.dist((wall.x, wall.y), (partner.x, partner.y)) > wall.reach + partner.reach + 2 * _LONGEST:
                continue
            corner = _crossing(wall, partner)
            if corner is None:
                continue
            missing = [max(0.0, abs(box.local(corner)[0]) - box.width / 2) for box in (wall, partner)]
            if max(missing) <= _LONGEST and sum(missing) > 2 * grid.resolution:
                yield sum(missing), first, second


def _crossing(first: Box, second: Box) -> Point | None:
    """Where the middle lines of two walls cross; None if they are nearly parallel."""
    sine = math.sin(second.yaw - first.yaw)
    if abs(sine) < _STEEPEST:
        return None
    dx, dy = second.x - first.x, second.y - first.y
    offset = (dx * math.sin(second.yaw) - dy * math.cos(second.yaw)) / sine
    return first.world((offset, 0.0))


def _may_reach(index: int, corner: Point, walls: Sequence[Box], grid: OccupancyGrid) -> bool:
    """Whether a wall reaches a point, or may go on up to there: its end meets no other wall, and what is between is not free."""
    wall = walls[index]
    offset, _ = wall.local(corner)
    gap = abs(offset) - wall.width / 2
    if gap <= 2 * grid.resolution:
        return True
    sign = math.copysign(1.0, offset)
    end = wall.world((sign * wall.width / 2, 0.0))
    if any(number != index and candidate.gap(end) <= _MEETING for number, candidate in enumerate(walls)):
        return False
    steps = wall.width / 2 + np.arange(grid.resolution / 2, gap, grid.resolution / 2)
    states = grid.state_at(np.array([wall.world((sign * float(step), 0.0)) for step in steps]))
    return float(np.mean(states == Cell.FREE)) <= _FREE


def _extended(wall: Box, corner: Point) -> Box:
    """The wall, up to a point if it does not reach it."""
    offset, _ = wall.local(corner)
    gap = abs(offset) - wall.width / 2
    if gap <= 0:
        return wall
    x, y = wall.world((math.copysign(gap / 2, offset), 0.0))
    return Box(x, y, wall.width + gap, wall.depth, wall.yaw)

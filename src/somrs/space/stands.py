"""Stands: the points on free space from which a robot reaches something."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from somrs.space.distances import distances_from
from somrs.space.free_space import FreeSpace
from somrs.space.solids import Point, Solid

ARM = 0.05
"""Half the width of an arm, m."""
EXTENSION = 2.0
"""How many metres of driving are worth a metre by which the arm reaches less far."""
ROOM, ENOUGH = 5.0, 0.1
"""How many metres of driving are worth a metre of clearance to spare, up to so much clearance in metres."""
ANGLE = math.pi / 12
"""The angle between two directions from which stands are looked for."""
DISTANCES = 6
"""The number of distances from the target at which stands are looked for."""
EDGE = 0.1
"""How far from the edge of a support things are put, m."""


@dataclass(frozen=True, slots=True)
class Stands:
    """Points (n, 2) in metres, and what robots do to stand at better ones, in metres of driving (n)."""

    points: NDArray[np.float64]
    costs: NDArray[np.float64]


def stands_around(space: FreeSpace, target: Point, radius: float, reach: tuple[float, float], height: float) -> Stands:
    """From where a robot of this radius reaches a point at a height. `reach`: the least and the largest distance, m."""
    return _stands(space, [target], np.arange(24.0)[None, :] * ANGLE, radius, reach, height)


def stands_at(space: FreeSpace, support: Solid, radius: float, reach: tuple[float, float]) -> Stands:
    """From where a robot puts something on a support, near its edge."""
    edges = [*edge_targets(support, EDGE)]
    towards = np.array([math.atan2(-y, -x) for _, (x, y) in edges])
    angles = towards[:, None] + np.array([0, -1, 1, -2, 2])[None, :] * ANGLE
    return _stands(space, [target for target, _ in edges], angles, radius, reach, support.top)


def _stands(
    space: FreeSpace, targets: list[Point], angles: NDArray[np.float64], radius: float, reach: tuple[float, float], height: float
) -> Stands:
    """`angles` (targets, n): the headings with which robots reach them."""
    distances = np.linspace(*reach, DISTANCES)
    spots = np.array(targets, dtype=float).reshape(-1, 1, 1, 2)
    headings = np.stack([np.cos(angles), np.sin(angles)], axis=-1)[:, :, None, :]
    bases = (spots - headings * distances[None, None, :, None]).reshape(-1, 2)
    ends = np.broadcast_to(spots, (len(targets), angles.shape[1], DISTANCES, 2)).reshape(-1, 2)
    room = space.clearances(bases)
    free = room >= radius
    bases, ends, room = bases[free], ends[free], room[free]
    clear = _arm_passes(space, bases, ends, height)
    bases, ends, room = bases[clear], ends[clear], room[clear]
    extension = np.hypot(*(ends - bases).T)
    return Stands(bases, EXTENSION * extension + ROOM * (ENOUGH - np.minimum(room - radius, ENOUGH)))


def _arm_passes(space: FreeSpace, bases: NDArray[np.float64], targets: NDArray[np.float64], height: float) -> NDArray[np.bool_]:
    """For each base and target, whether nothing that is higher than the target's support is between them."""
    if not len(bases):
        return np.zeros(0, dtype=bool)
    corners = np.concatenate([bases, targets])
    (left, bottom), (right, top) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    near_solids = space.solids_near((left - ARM, bottom - ARM, right + ARM, top + ARM))
    tall = [solid for solid in near_solids if solid.top > height + 0.02]
    count = max(2, math.ceil(float(np.hypot(*(targets - bases).T).max()) / ARM))
    shares = np.linspace(0, 1, count + 1)[:, None, None]
    points = (bases * (1 - shares) + targets * shares).reshape(-1, 2)
    clear = np.ones(len(bases), dtype=bool)
    for solid in tall:
        clear &= distances_from(solid, points).reshape(count + 1, -1).min(axis=0) >= ARM
    return clear


def edge_targets(solid: Solid, inset: float, spacing: float = 0.2) -> Iterator[tuple[Point, Point]]:
    """Points on a solid's top, `inset` from its edge or less where it is narrow, each with the outward normal of the edge."""
    for (start_x, start_y), (end_x, end_y) in _edges(solid):
        long = math.hypot(end_x - start_x, end_y - start_y)
        if long == 0:
            continue
        dx, dy = (end_x - start_x) / long, (end_y - start_y) / long
        count = max(1, int((long - 2 * inset) / spacing) + 1) if long > 2 * inset else 1
        for i in range(count):
            offset = long / 2 + (i - (count - 1) / 2) * min(spacing, max(long - 2 * inset, 0.0) / max(count - 1, 1) or spacing)
            depth, point = inset, solid.world(start_x + offset * dx - inset * dy, start_y + offset * dy + inset * dx)
            while depth > 0.03 and solid.distance(*point) > -0.9 * depth:
                depth *= 0.8
                point = solid.world(start_x + offset * dx - depth * dy, start_y + offset * dy + depth * dx)
            if depth > 0.03:
                c, s = math.cos(solid.yaw), math.sin(solid.yaw)
                yield point, (c * dy + s * dx, s * dy - c * dx)


def _edges(solid: Solid) -> list[tuple[Point, Point]]:
    """The edges of the outline in the solid's own frame, counter-clockwise: the inside is on the left."""
    corners = list(solid.corners(sides=16))
    ends = corners[1:] + corners[:1]
    if sum(start[0] * end[1] - end[0] * start[1] for start, end in zip(corners, ends, strict=True)) < 0:
        corners.reverse()
    return list(zip(corners, corners[1:] + corners[:1], strict=True))

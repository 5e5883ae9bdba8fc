"""Points along the edge of the top of a solid."""

from __future__ import annotations

import math
from collections.abc import Iterator

from somrs.space.solids import Point, Solid


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

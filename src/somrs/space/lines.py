"""Distances between points and line segments in the plane."""

from __future__ import annotations

import math

from somrs.space.solids import Point


def point_distance(point: Point, start: Point, end: Point) -> float:
    """Distance from a point to a line segment."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    share = ((point[0] - start[0]) * dx + (point[1] - start[1]) * dy) / (dx * dx + dy * dy or 1.0)
    share = max(0.0, min(1.0, share))
    return math.hypot(point[0] - start[0] - share * dx, point[1] - start[1] - share * dy)


def segment_distance(start: Point, end: Point, other_start: Point, other_end: Point) -> float:
    """Distance between two line segments; 0 if they cross."""

    def side(p: Point, q: Point, r: Point) -> float:
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    if (
        side(start, end, other_start) * side(start, end, other_end) < 0
        and side(other_start, other_end, start) * side(other_start, other_end, end) < 0
    ):
        return 0.0
    return min(
        point_distance(start, other_start, other_end),
        point_distance(end, other_start, other_end),
        point_distance(other_start, start, end),
        point_distance(other_end, start, end),
    )

"""Distances of solids from many points at once, with numpy. Separate from `solids.py`, which the map's drawing uses without numpy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from somrs.space.solids import Point, Solid

Array = npt.NDArray[np.float64]
STEP = 0.05
"""Distance between the points at which lines and outlines are sampled, m; walls are thicker."""


def distances_from(solid: Solid, points: Array) -> Array:
    """Distances (n) from the solid's outline to points (n, 2), seen from above; negative inside."""
    c, s = math.cos(solid.yaw), math.sin(solid.yaw)
    dx, dy = points[:, 0] - solid.x, points[:, 1] - solid.y
    u, v = c * dx + s * dy, c * dy - s * dx
    match solid.form:
        case "Box":
            excess_x, excess_y = np.abs(u) - solid.width / 2, np.abs(v) - solid.depth / 2
            return np.asarray(
                np.hypot(np.maximum(excess_x, 0.0), np.maximum(excess_y, 0.0)) + np.minimum(np.maximum(excess_x, excess_y), 0.0)
            )
        case "Polygon":
            return _polygon_distances(solid.outline, u, v)
    return np.asarray(np.hypot(u, v) - solid.radius)


def _polygon_distances(outline: tuple[Point, ...], u: Array, v: Array) -> Array:
    """Signed distances of points from a polygon's edge, negative inside; the even-odd rule defines the inside."""
    nearest, interior = np.full(u.shape, np.inf), np.zeros(u.shape, dtype=bool)
    for start, end in zip(outline, (*outline[1:], outline[0]), strict=True):
        nearest = np.minimum(nearest, distances_from_segment(u, v, start, end))
        (start_x, start_y), (end_x, end_y) = start, end
        if start_y != end_y:
            interior ^= ((start_y > v) != (end_y > v)) & (u < start_x + (v - start_y) / (end_y - start_y) * (end_x - start_x))
    return np.where(interior, -nearest, nearest)


def distances_from_segment(x: npt.NDArray[Any], y: npt.NDArray[Any], start: Point, end: Point) -> npt.NDArray[Any]:
    """Distances of points from a line segment. `x`, `y`: the coordinates of the points, as arrays that broadcast together."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    offset_x, offset_y = x - start[0], y - start[1]
    share = np.clip((offset_x * dx + offset_y * dy) / (dx * dx + dy * dy or 1.0), 0.0, 1.0)
    return np.asarray(np.hypot(offset_x - share * dx, offset_y - share * dy))


def points_along(start: Point, end: Point) -> Array:
    """Points (n, 2) on the line from start to end, both included, not farther apart than `STEP`."""
    share = np.linspace(0, 1, max(2, math.ceil(math.dist(start, end) / STEP) + 1))[:, None]
    return np.asarray(start) * (1 - share) + np.asarray(end) * share


def outline_points(solid: Solid) -> Array:
    """Points (n, 2) on the outline of a solid, and its position if this is inside it: that of a polygon may be anywhere."""
    corners = [solid.world(*corner) for corner in solid.corners()]
    edges = [points_along(start, end) for start, end in zip(corners, [*corners[1:], corners[0]], strict=True)]
    return np.concatenate([*edges, [(solid.x, solid.y)]] if solid.distance(solid.x, solid.y) < 0 else edges)

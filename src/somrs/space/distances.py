"""Distances of solids from many points at once, with numpy. Separate from `solids.py`, which the map's drawing uses without numpy."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from somrs.space.solids import Point, Solid

Array = npt.NDArray[np.float64]


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
    for (start_x, start_y), (end_x, end_y) in zip(outline, (*outline[1:], outline[0]), strict=True):
        dx, dy = end_x - start_x, end_y - start_y
        share = np.clip(((u - start_x) * dx + (v - start_y) * dy) / (dx * dx + dy * dy or 1.0), 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(u - start_x - share * dx, v - start_y - share * dy))
        if start_y != end_y:
            interior ^= ((start_y > v) != (end_y > v)) & (u < start_x + (v - start_y) / (end_y - start_y) * dx)
    return np.where(interior, -nearest, nearest)

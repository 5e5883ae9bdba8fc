"""How far solids are from many points at once, for the simulator; what only draws the map needs no numpy."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from somrs.devices.simulator.world.solids import Point, Solid

Array = npt.NDArray[np.float64]


def distances_from(solid: Solid, points: Array) -> Array:
    """From its outline to each of the points (n, 2), seen from above; negative inside."""
    c, s = math.cos(solid.yaw), math.sin(solid.yaw)
    dx, dy = points[:, 0] - solid.x, points[:, 1] - solid.y
    u, v = c * dx + s * dy, c * dy - s * dx
    match solid.form:
        case "Box":
            a, b = np.abs(u) - solid.width / 2, np.abs(v) - solid.depth / 2
            return np.asarray(np.hypot(np.maximum(a, 0.0), np.maximum(b, 0.0)) + np.minimum(np.maximum(a, b), 0.0))
        case "Polygon":
            return _polygon_distances(solid.outline, u, v)
    return np.asarray(np.hypot(u, v) - solid.radius)


def _polygon_distances(outline: tuple[Point, ...], u: Array, v: Array) -> Array:
    """Signed distances of points to a polygon's edge; the even-odd rule says what is inside."""
    nearest, inside = np.full(u.shape, np.inf), np.zeros(u.shape, dtype=bool)
    for (ax, ay), (bx, by) in zip(outline, (*outline[1:], outline[0]), strict=True):
        dx, dy = bx - ax, by - ay
        share = np.clip(((u - ax) * dx + (v - ay) * dy) / (dx * dx + dy * dy or 1.0), 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(u - ax - share * dx, v - ay - share * dy))
        if ay != by:
            inside ^= ((ay > v) != (by > v)) & (u < ax + (v - ay) / (by - ay) * dx)
    return np.where(inside, -nearest, nearest)

"""Floor plans of rooms in rows and columns, and occupancy grids of them, for tests of what makes buildings of grids."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from somrs.sites.occupancy.grid import Cell, OccupancyGrid
from somrs.sites.plan import Box


@dataclass(frozen=True, kw_only=True)
class FloorPlan:
    """Walls and doors as rectangles, and the middles of the rooms, in metres."""

    walls: list[Box] = field(default_factory=list)
    doors: list[Box] = field(default_factory=list)
    rooms: list[tuple[float, float]] = field(default_factory=list)
    width: float = 0.0
    depth: float = 0.0


def rooms_in_rows(
    widths: Sequence[float], depths: Sequence[float], thickness: float, doors: Sequence[tuple[float, float] | None]
) -> FloorPlan:
    """A plan of rooms, with walls of this thickness between and around them.

    `doors`: for each wall between two rooms, in order, the width of its door and where it is, from 0 to 1; None for none. Those that are
    missing have none.
    """
    xs, ys = np.concatenate([[0.0], np.cumsum(widths)]), np.concatenate([[0.0], np.cumsum(depths)])
    plan = FloorPlan(width=float(xs[-1]), depth=float(ys[-1]))
    remaining = list(doors)
    for row in range(len(depths) + 1):
        for column, room_width in enumerate(widths):
            inner = 0 < row < len(depths)
            door = remaining.pop(0) if inner and remaining else None
            _wall(plan, (float(xs[column]), float(ys[row])), room_width, 0.0, thickness, door)
    for column in range(len(widths) + 1):
        for row, room_depth in enumerate(depths):
            inner = 0 < column < len(widths)
            door = remaining.pop(0) if inner and remaining else None
            _wall(plan, (float(xs[column]), float(ys[row])), room_depth, math.pi / 2, thickness, door)
    plan.rooms.extend((float(x), float(y)) for x in (xs[1:] + xs[:-1]) / 2 for y in (ys[1:] + ys[:-1]) / 2)
    return plan


def _wall(
    plan: FloorPlan, start: tuple[float, float], length: float, yaw: float, thickness: float, door: tuple[float, float] | None
) -> None:
    def piece(low: float, high: float) -> Box:
        middle = (low + high) / 2
        return Box(start[0] + middle * math.cos(yaw), start[1] + middle * math.sin(yaw), high - low, thickness, yaw)

    if door is None:
        plan.walls.append(piece(-thickness / 2, length + thickness / 2))
        return
    width, share = door
    low = 0.6 + share * (length - width - 1.2)
    plan.walls.extend([piece(-thickness / 2, low), piece(low + width, length + thickness / 2)])
    plan.doors.append(piece(low, low + width))


def grid_of(
    plan: FloorPlan, *, resolution: float = 0.05, yaw: float = 0.0, skin: float = 0.06, obstacles: Sequence[Box] = ()
) -> OccupancyGrid:
    """The grid of a plan as a robot would see it: of walls and obstacles, only what is at most `skin` from their faces is occupied, and the
    rest of them is unknown. `yaw`: the grid is turned against the plan by this angle.
    """
    reach = math.hypot(plan.width, plan.depth) / 2 + 1.0
    side = math.ceil(2 * reach / resolution)
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y = plan.width / 2 - reach * (cos - sin), plan.depth / 2 - reach * (sin + cos)
    grid = OccupancyGrid(states=np.full((side, side), Cell.UNKNOWN, dtype=np.int8), resolution=resolution, x=x, y=y, yaw=yaw)
    points = grid.to_map(grid.centres(np.ones((side, side), dtype=bool)))
    states = grid.states.ravel()
    is_within_box = (points[:, 0] > 0) & (points[:, 0] < plan.width) & (points[:, 1] > 0) & (points[:, 1] < plan.depth)
    states[is_within_box] = Cell.FREE
    for box in (*plan.walls, *obstacles):
        depth = depth_in(box, points)
        states[depth >= 0] = Cell.UNKNOWN
    is_free = (states == Cell.FREE).reshape(side, side)
    from scipy import ndimage

    distance = ndimage.distance_transform_edt(~is_free) * resolution
    for box in (*plan.walls, *obstacles):
        depth = depth_in(box, points)
        states[(depth >= 0) & (distance.ravel() <= skin)] = Cell.OCCUPIED
    return grid


def depth_in(box: Box, points: np.ndarray) -> np.ndarray:
    """How deep points (n × 2, m) are in a rectangle, m; negative outside, by the larger of both distances from its edges."""
    (ux, uy), (vx, vy) = box.axes
    shifted = points - (box.x, box.y)
    u_offset, v_offset = np.abs(shifted @ (ux, uy)), np.abs(shifted @ (vx, vy))
    return np.minimum(box.width / 2 - u_offset, box.depth / 2 - v_offset)


def points_along(box: Box, step: float = 0.05) -> np.ndarray:
    """Points of the middle line of a rectangle, n × 2, m."""
    count = max(1, round(box.width / step))
    offsets = ((np.arange(count) + 0.5) / count - 0.5) * box.width
    return np.array([box.world((float(offset), 0.0)) for offset in offsets])


def share_within(points: np.ndarray, boxes: Sequence[Box], distance: float) -> float:
    """The share of the points that are at most so far from one of the rectangles, m."""
    if not len(points):
        return 1.0
    return sum(any(box.gap((float(x), float(y))) <= distance for box in boxes) for x, y in points) / len(points)

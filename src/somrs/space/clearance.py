"""The ground as a grid of cells, and the clearance of each cell: the distance of its centre from the nearest obstacle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise, product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from somrs.space.distances import distances_from, distances_from_segment
from somrs.space.solids import Point, Solid

CELL = 0.05
"""Width of a cell, m."""
FAR = 1.0
"""Largest clearance that is computed, m: robots are narrower."""
TILE = 256
"""Cells along the side of a tile, whose distances are computed together."""
PIECE = 2.0
"""How far an edge of the ground may run in both directions of the grid to be looked at in one piece, m."""

Field = NDArray[np.float32]
"""Clearance by row (y) and column (x), m."""
Cell = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Disc:
    """A temporary obstacle: a robot, or a thing on the floor."""

    x: float
    y: float
    radius: float

    def distance(self, point: Point) -> float:
        return math.hypot(point[0] - self.x, point[1] - self.y) - self.radius


@dataclass(frozen=True, slots=True)
class Grid:
    """A grid of square cells. `x`, `y` are its lower left corner on the map, in metres."""

    x: float
    y: float
    rows: int
    columns: int
    size: float = CELL

    @staticmethod
    def enclosing(solids: Sequence[Solid], margin: float) -> Grid:
        """A grid that contains all solids, with a margin around them."""
        boxes = [(*solid.world(u, v),) for solid in solids for u, v in _corners(solid)] or [(-5.0, -5.0), (5.0, 5.0)]
        min_x, min_y = (min(c[i] for c in boxes) - margin for i in (0, 1))
        max_x, max_y = (max(c[i] for c in boxes) + margin for i in (0, 1))
        return Grid(min_x, min_y, math.ceil((max_y - min_y) / CELL), math.ceil((max_x - min_x) / CELL))

    def clipped(self, point: Point) -> Cell:
        """The cell of the point, or the nearest cell."""
        row, column = int((point[1] - self.y) // self.size), int((point[0] - self.x) // self.size)
        return min(max(row, 0), self.rows - 1), min(max(column, 0), self.columns - 1)

    def cell(self, point: Point) -> Cell | None:
        row, column = int((point[1] - self.y) // self.size), int((point[0] - self.x) // self.size)
        return (row, column) if 0 <= row < self.rows and 0 <= column < self.columns else None

    def centre(self, cell: Cell) -> Point:
        return self.x + (cell[1] + 0.5) * self.size, self.y + (cell[0] + 0.5) * self.size

    def centres(self, cells: NDArray[Any]) -> NDArray[np.float64]:
        """The centres (n, 2) of cells (n, 2), given as rows and columns."""
        return np.stack([self.x + (cells[:, 1] + 0.5) * self.size, self.y + (cells[:, 0] + 0.5) * self.size], axis=1)

    def sample(self, field: Field, points: ArrayLike) -> Field:
        """The field at points (n, 2), interpolated linearly between cell centres; -FAR outside the grid."""
        positions = np.asarray(points, dtype=float).reshape(-1, 2)
        coordinates = [(positions[:, 1] - self.y) / self.size - 0.5, (positions[:, 0] - self.x) / self.size - 0.5]
        values: Field = ndimage.map_coordinates(field, coordinates, order=1, mode="constant", cval=-FAR)
        return values

    def value(self, field: Field, point: Point) -> float:
        """The field at one point, as `sample` interpolates it: for one point this takes a tenth of the time."""
        row, column = (point[1] - self.y) / self.size - 0.5, (point[0] - self.x) / self.size - 0.5
        if not (0 <= row <= self.rows - 1 and 0 <= column <= self.columns - 1):
            return -FAR
        low, left = int(row), int(column)
        high, right = min(low + 1, self.rows - 1), min(left + 1, self.columns - 1)
        up, along = row - low, column - left
        lower = field.item(low, left) * (1 - along) + field.item(low, right) * along
        upper = field.item(high, left) * (1 - along) + field.item(high, right) * along
        return float(lower * (1 - up) + upper * up)

    def window(self, min_x: float, min_y: float, max_x: float, max_y: float) -> tuple[tuple[slice, slice], Field, Field]:
        """The cells whose centres are in a box: their slices, and the x and y of their centres, as arrays that broadcast together."""
        c0, c1 = (max(0, min(self.columns, math.ceil((v - self.x) / self.size - 0.5))) for v in (min_x, max_x))
        r0, r1 = (max(0, min(self.rows, math.ceil((v - self.y) / self.size - 0.5))) for v in (min_y, max_y))
        xs = (self.x + (np.arange(c0, c1) + 0.5) * self.size).astype(np.float32)
        ys = (self.y + (np.arange(r0, r1) + 0.5) * self.size).astype(np.float32)
        return (slice(r0, r1), slice(c0, c1)), xs[None, :], ys[:, None]

    def with_discs(self, field: Field, discs: Sequence[Disc]) -> Field:
        """The field with the discs as additional obstacles."""
        if not discs:
            return field
        field = field.copy()
        for disc in discs:
            far = disc.radius + FAR
            slices, xs, ys = self.window(disc.x - far, disc.y - far, disc.x + far, disc.y + far)
            field[slices] = np.minimum(field[slices], np.hypot(xs - disc.x, ys - disc.y) - disc.radius)
        return field


def clearances(grid: Grid, obstacles: Sequence[Solid], floors: Sequence[Solid], passages: Sequence[Solid]) -> Field:
    """The distance of each cell's centre from the nearest obstacle and, if there are floors, from their edge.

    It is negative inside obstacles and beyond the edge. Passages count as floor, even where the map models no floor under them.
    """
    field: Field = np.full((grid.rows, grid.columns), FAR, dtype=np.float32)
    if floors:
        field = edge_distances(grid, tuple(floors), tuple(replace(passage, open=False) for passage in passages)).copy()
    for solid in obstacles:
        slices, distance = _distances(grid, solid, FAR)
        field[slices] = np.minimum(field[slices], distance)
    field[[0, -1], :] = field[:, [0, -1]] = -FAR  # a border of obstacles, so that no step of the search leaves the grid
    return np.clip(field, -FAR, FAR)


@lru_cache(maxsize=4)
def edge_distances(grid: Grid, floors: tuple[Solid, ...], passages: tuple[Solid, ...]) -> Field:
    """The distance of each cell's centre from the edge of the ground, at most `FAR`, negative beyond the edge.

    It is kept, because it is the same for all states of doors and for all furniture. Distances farther than `FAR` do not count, so each
    tile of cells needs only its surroundings, and a tile in the middle of the ground, or far outside, needs nothing.
    """
    ground = np.zeros((grid.rows, grid.columns), dtype=bool)
    for solid, margin in [(floor, grid.size / 2) for floor in floors] + [(passage, 2 * grid.size) for passage in passages]:
        mark(grid, solid, margin, ground)
    field: Field = np.where(ground, np.float32(FAR), np.float32(-FAR))
    reach = math.ceil(FAR / grid.size) + 1
    for row, column in product(range(0, grid.rows, TILE), range(0, grid.columns, TILE)):
        first_row, first_column = max(row - reach, 0), max(column - reach, 0)
        surroundings = ground[first_row : row + TILE + reach, first_column : column + TILE + reach]
        if surroundings.all() or not surroundings.any():
            continue
        inner_distance = ndimage.distance_transform_edt(surroundings) - 0.5
        outer_distance = ndimage.distance_transform_edt(~surroundings) - 0.5
        distance = np.where(surroundings, inner_distance, -outer_distance) * grid.size
        own = slice(row - first_row, row - first_row + TILE), slice(column - first_column, column - first_column + TILE)
        field[row : row + TILE, column : column + TILE] = np.clip(distance[own], -FAR, FAR)
    field.flags.writeable = False
    return field


def mark(grid: Grid, solid: Solid, margin: float, ground: NDArray[np.bool_]) -> None:
    """Mark the cells whose centres are in the outline of a solid, or no farther from it than the margin."""
    if solid.form not in ("Box", "Polygon"):
        slices, distance = _distances(grid, solid, margin + grid.size)
        ground[slices] |= distance <= margin
        return
    corners = np.array([solid.world(u, v) for u, v in _corners(solid)])
    ends = np.roll(corners, -1, axis=0)
    fill(grid, corners, ground)
    for start, end in zip(corners, ends, strict=True):
        pieces = max(1, math.ceil(float(np.abs(end - start).min()) / PIECE))  # the box around a long slanting edge has many cells
        points = start + (end - start) * np.linspace(0, 1, pieces + 1)[:, None]
        for (start_x, start_y), (end_x, end_y) in pairwise(points.tolist()):
            low_x, high_x, low_y, high_y = min(start_x, end_x), max(start_x, end_x), min(start_y, end_y), max(start_y, end_y)
            slices, x, y = grid.window(low_x - margin, low_y - margin, high_x + margin, high_y + margin)
            ground[slices] |= distances_from_segment(x, y, (start_x, start_y), (end_x, end_y)) <= margin


def fill(grid: Grid, corners: NDArray[np.float64], ground: NDArray[np.bool_]) -> None:
    """Mark the cells whose centres are in a polygon: row by row, from each edge that the row crosses to the next one."""
    ends = np.roll(corners, -1, axis=0)
    low, high = (grid.clipped((0.0, float(y)))[0] for y in (corners[:, 1].min(), corners[:, 1].max()))
    ys = grid.y + (np.arange(low, high + 1) + 0.5) * grid.size
    for row, y in enumerate(ys.tolist(), low):
        crossing = (corners[:, 1] > y) != (ends[:, 1] > y)
        start, end = corners[crossing], ends[crossing]
        xs = np.sort(start[:, 0] + (y - start[:, 1]) / (end[:, 1] - start[:, 1]) * (end[:, 0] - start[:, 0]))
        columns = np.clip(np.ceil((xs - grid.x) / grid.size - 0.5), 0, grid.columns).astype(int).tolist()
        for first, last in zip(columns[::2], columns[1::2], strict=True):
            ground[row, first:last] = True


def _distances(grid: Grid, solid: Solid, margin: float) -> tuple[tuple[slice, slice], Field]:
    """Slices of the cells within `margin` of a solid, and their signed distances from its outline."""
    on_map = [solid.world(u, v) for u, v in _corners(solid)]
    xs, ys = [c[0] for c in on_map], [c[1] for c in on_map]
    slices, x, y = grid.window(min(xs) - margin, min(ys) - margin, max(xs) + margin, max(ys) + margin)
    points = np.stack(np.broadcast_arrays(x, y), axis=-1).reshape(-1, 2)
    return slices, distances_from(solid, points).reshape(y.size, x.size).astype(np.float32)


def _corners(solid: Solid) -> Sequence[Point]:
    """The corners of an outline around a solid, in its own frame: its own, or a square around a cylinder."""
    if solid.form in ("Box", "Polygon"):
        return solid.corners()
    radius = solid.radius
    return (-radius, -radius), (radius, -radius), (radius, radius), (-radius, radius)

"""The ground as a grid of cells, and the clearance of each cell: the distance of its centre from the nearest obstacle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from somrs.space.distances import distances_from
from somrs.space.solids import Point, Solid

CELL = 0.05
"""Width of a cell, m."""
FAR = 1.0
"""Largest clearance that is computed, m: robots are narrower."""

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
        ground = np.zeros(field.shape, dtype=bool)
        for solid, margin in [(floor, grid.size / 2) for floor in floors] + [(passage, 2 * grid.size) for passage in passages]:
            slices, distance = _distances(grid, solid, margin + grid.size)
            ground[slices] |= distance <= margin
        inner_distance = ndimage.distance_transform_edt(ground) - 0.5
        outer_distance = ndimage.distance_transform_edt(~ground) - 0.5
        field = np.minimum(field, np.where(ground, inner_distance, -outer_distance) * grid.size).astype(np.float32)
    for solid in obstacles:
        slices, distance = _distances(grid, solid, FAR)
        field[slices] = np.minimum(field[slices], distance)
    field[[0, -1], :] = field[:, [0, -1]] = -FAR  # a border of obstacles, so that no step of the search leaves the grid
    return np.clip(field, -FAR, FAR)


def _distances(grid: Grid, solid: Solid, margin: float) -> tuple[tuple[slice, slice], Field]:
    """Slices of the cells within `margin` of a solid, and their signed distances from its outline."""
    on_map = [solid.world(u, v) for u, v in _corners(solid)]
    xs, ys = [c[0] for c in on_map], [c[1] for c in on_map]
    slices, x, y = grid.window(min(xs) - margin, min(ys) - margin, max(xs) + margin, max(ys) + margin)
    points = np.stack(np.broadcast_arrays(x, y), axis=-1).reshape(-1, 2)
    return slices, distances_from(solid, points).reshape(y.size, x.size).astype(np.float32)


def _corners(solid: Solid) -> Sequence[Point]:
    """The corners of an outline around a solid, in its own frame: its polygon, or a box."""
    if solid.form == "Polygon":
        return solid.outline
    w, d = (solid.width / 2, solid.depth / 2) if solid.form == "Box" else (solid.radius, solid.radius)
    return [(-w, -d), (w, -d), (w, d), (-w, d)]

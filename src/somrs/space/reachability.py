"""Which points of a storey robots can get to from which: the connected regions of its free ground."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from scipy import ndimage

from somrs.space.clearance import CELL, Grid, clearances
from somrs.space.solids import Point, Solid

COARSE = 0.1
"""Width of a cell, m: fine enough for doors."""
_MOST_CELLS = 12_000_000
"""The number of cells above which the cells become larger: ground of this size has no doors."""
_NEAR = 0.4
"""How far the free cell that stands for a point may be from it, m."""


class Ground:
    """The ground of a storey for robots of a radius. What is a passage is open."""

    def __init__(self, standing: Sequence[Solid], floors: Sequence[Solid], passages: Sequence[Solid], radius: float) -> None:
        fine = Grid.enclosing(floors or standing, margin=0.5)
        size = max(COARSE, CELL * math.sqrt(fine.rows * fine.columns / _MOST_CELLS))
        self.grid = replace(fine, rows=math.ceil(fine.rows * CELL / size), columns=math.ceil(fine.columns * CELL / size), size=size)
        field = clearances(self.grid, standing, floors, passages)
        # Half a cell less: a way that is just wide enough may have no cell in its middle.
        self.labels, self.count = ndimage.label(field >= radius - size / 2, structure=np.ones((3, 3)))

    def region(self, point: Point) -> int | None:
        """The number of the region that the point is in, or is next to; None if there is no free ground around it."""
        cell = self.grid.cell(point)
        if cell is None:
            return None
        span = math.ceil(_NEAR / self.grid.size)
        row, column = cell
        window = self.labels[max(row - span, 0) : row + span + 1, max(column - span, 0) : column + span + 1]
        near_cells = np.argwhere(window > 0)
        if not len(near_cells):
            return None
        middle = min(row, span), min(column, span)
        nearest = near_cells[np.argmin(((near_cells - middle) ** 2).sum(axis=1))]
        return int(window[tuple(nearest)])

    def regions(self, points: Iterable[Point]) -> set[int]:
        return {region for point in points if (region := self.region(point)) is not None}

    def largest(self, points: Iterable[Point]) -> set[int]:
        """The region with the most of the points."""
        counts = Counter(region for point in points if (region := self.region(point)) is not None)
        return {counts.most_common(1)[0][0]} if counts else set()

"""Which place each free cell of a floor sees: to which a robot drives from there in a straight line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from somrs.space.free_space import SLACK, FreeSpace

SAMPLES = 8
"""Points of a line at which its clearance is looked at."""
ERROR = 0.9
"""By how many widths of a cell the interpolated clearance differs at most from that of the nearest cell, as nowhere it changes faster than
the distance does."""
OCCUPIED, UNSEEN = -2, -1

Points = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Crossings:
    """Where a robot can drive from a cell that sees one place to a neighbouring cell that sees another: for each such pair of places, their
    numbers, and the centres of two cells."""

    low: NDArray[np.int64]
    high: NDArray[np.int64]
    starts: Points
    ends: Points


@dataclass(slots=True)
class Coverage:
    """The cells of the floor, of which those with `free` belong to robots that need the clearance `radius`, in metres. A place is seen from
    as far as `reach`, in metres."""

    space: FreeSpace
    free: Mask
    radius: float
    reach: float
    seen: NDArray[np.int32] = field(init=False)
    """By cell: the number of the first place that was noted and is seen from there; UNSEEN, or OCCUPIED."""

    def __post_init__(self) -> None:
        self.seen = np.where(self.free, np.int32(UNSEEN), np.int32(OCCUPIED))

    @property
    def _surely_clear(self) -> float:
        """The clearance of cells near which a robot drives anywhere, m."""
        return self.radius - SLACK + ERROR * self.space.grid.size

    def renumbered(self, numbers: NDArray[np.int64]) -> Coverage:
        """This coverage with other numbers of the places; UNSEEN for those that are left out."""
        renumbered = Coverage(self.space, self.free, self.radius, self.reach)
        if len(numbers):
            renumbered.seen = np.where(self.seen >= 0, numbers[self.seen], self.seen).astype(np.int32)
        return renumbered

    def note(self, point: Sequence[float] | Points, number: int) -> None:
        """Mark the cells from which a place at this point is seen, if they see no earlier one."""
        size, point = self.space.grid.size, np.asarray(point, dtype=float)
        middle_row, middle_column = (point[1] - self.space.grid.y) / size - 0.5, (point[0] - self.space.grid.x) / size - 0.5
        reach = self.reach / size
        first_row, first_column = max(math.ceil(middle_row - reach), 0), max(math.ceil(middle_column - reach), 0)
        window = self.seen[first_row : math.floor(middle_row + reach) + 1, first_column : math.floor(middle_column + reach) + 1]
        rows, columns = first_row + np.arange(window.shape[0]), first_column + np.arange(window.shape[1])
        distance = np.hypot((rows - middle_row)[:, None], (columns - middle_column)[None, :])
        near = (window == UNSEEN) & (distance <= reach)
        if not near.any():
            return
        field = self.space.field[first_row : first_row + window.shape[0], first_column : first_column + window.shape[1]]
        if float(field.min()) >= self._surely_clear:
            window[near] = number
            return
        room = float(self.space.clearances([point])[0]) - self.radius
        visible = near & (distance * size <= room)  # all that is so near is free
        if len(cells := np.argwhere(near & ~visible)):
            lowest = self._lowest(middle_row, middle_column, cells + np.array([first_row, first_column]))
            is_clear, doubtful = lowest >= self._surely_clear, np.flatnonzero(np.abs(lowest - (self.radius - SLACK)) < ERROR * size)
            centres = self.space.grid.centres(cells[doubtful] + np.array([first_row, first_column]))
            is_clear[doubtful] = self.are_clear(np.broadcast_to(point, centres.shape), centres)
            visible[cells[is_clear, 0], cells[is_clear, 1]] = True
        window[visible] = number

    def _lowest(self, middle_row: float, middle_column: float, cells: NDArray[np.int64]) -> NDArray[np.float32]:
        """The lowest clearance of the cells nearest to the samples of the lines from a point to these cells (n, 2), roughly."""
        clearance = self.space.field
        lowest = clearance[cells[:, 0], cells[:, 1]]
        for share in np.linspace(0, 1, SAMPLES + 1)[:-1]:
            on_rows = np.rint(middle_row * (1 - share) + cells[:, 0] * share).astype(np.intp)
            on_columns = np.rint(middle_column * (1 - share) + cells[:, 1] * share).astype(np.intp)
            np.minimum(lowest, clearance[on_rows, on_columns], out=lowest)
        return lowest

    def are_clear(self, starts: Points, ends: Points) -> Mask:
        """Whether a robot can drive in a straight line, for each pair of points (n, 2)."""
        shares = np.linspace(0, 1, SAMPLES + 1)[:, None, None]
        points = np.asarray(starts) * (1 - shares) + np.asarray(ends) * shares
        clearances = self.space.clearances(points.reshape(-1, 2)).reshape(SAMPLES + 1, -1)
        return np.asarray(clearances.min(axis=0) >= self.radius - SLACK)

    def _are_joined(self, starts: NDArray[np.int64], ends: NDArray[np.int64]) -> Mask:
        """Whether a robot can drive between each two neighbouring cells (n, 2); it may not, from corner to corner of them."""
        field, grid = self.space.field, self.space.grid
        clear: Mask = np.minimum(field[starts[:, 0], starts[:, 1]], field[ends[:, 0], ends[:, 1]]) >= self._surely_clear
        doubtful = np.flatnonzero(~clear)
        clear[doubtful] = self.are_clear(grid.centres(starts[doubtful]), grid.centres(ends[doubtful]))
        return clear

    def unseen(self) -> NDArray[np.int64]:
        """The free cells (n, 2) that see no place, those with the most clearance first."""
        cells = np.argwhere(self.seen == UNSEEN)
        return cells[np.argsort(-self.space.field[cells[:, 0], cells[:, 1]], kind="stable")]

    def crossings(self) -> Crossings:
        """One crossing for each pair of places for which there is any."""
        parts: list[tuple[NDArray[np.int64], ...]] = []
        grid, (height, width) = self.space.grid, self.seen.shape
        for rows, columns in ((0, 1), (1, 0), (1, 1), (1, -1)):
            here = self.seen[: height - rows, max(-columns, 0) : width - max(columns, 0)]
            there = self.seen[rows:, max(columns, 0) : width + min(columns, 0)]
            cells = np.argwhere((here != there) & (here >= 0) & (there >= 0)) + np.array([0, max(-columns, 0)])
            starts, ends = cells, cells + np.array([rows, columns])
            clear = self._are_joined(starts, ends)
            parts.append((starts[clear], ends[clear]))
        starts, ends = (np.concatenate(cells).reshape(-1, 2) for cells in zip(*parts, strict=True))
        on_one, on_other = (self.seen[cells[:, 0], cells[:, 1]].astype(np.int64) for cells in (starts, ends))
        low, high = np.minimum(on_one, on_other), np.maximum(on_one, on_other)
        first = np.sort(np.unique(low * (high.max(initial=0) + 1) + high, return_index=True)[1])
        return Crossings(low=low[first], high=high[first], starts=grid.centres(starts[first]), ends=grid.centres(ends[first]))

"""The evidence of a robot's scans for what is free and what is occupied: log odds by cell, on a grid that grows with what it has seen.

Moravec and Elfes, "High resolution maps from wide angle sonar" (1985); Thrun, Burgard and Fox, "Probabilistic Robotics", chapter 9.
Coordinates are those of the map, in metres; angles in radians.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from somrs.sites.occupancy.grid import Cell, Mask, OccupancyGrid, States

RESOLUTION = 0.05
"""The side of a cell, m."""
_HIT, _MISS = 0.9, -0.4
"""How much a ray that ends in a cell, or passes it, changes its log odds."""
_SUREST = 4.0
"""The largest log odds: a cell whose content changes is seen to change after a few scans."""
_OCCUPIED, _FREE = 0.8, -0.3
"""Log odds from which on, and up to which, a cell counts as occupied and as free."""
_DEPTH = 0.25
"""How deep in what it has hit a ray ends, in cells: a face between two cells is in the one behind it."""
_MARGIN = 20
"""Cells by which the grid grows more than it needs to."""

Indexes = npt.NDArray[np.int64]


class Evidence:
    """What scans have shown so far."""

    def __init__(self, resolution: float = RESOLUTION) -> None:
        self.resolution = resolution
        self._log_odds = np.zeros((0, 0), dtype=np.float32)
        self._corner = (0, 0)
        """Row and column of the first cell, where the cell (0, 0) has its corner at the origin of the map."""

    def add_scan(self, x: float, y: float, angles: npt.NDArray[np.float64], ranges: Sequence[float | None], reach: float) -> None:
        """Add a scan from a point. `angles`: the directions of the rays on the map; `ranges`: the distance to what each has hit, None: it
        has hit nothing within `reach`."""
        is_hit = np.array([distance is not None for distance in ranges], dtype=bool)
        lengths = np.array([reach if distance is None else distance for distance in ranges], dtype=float)
        hits = _cells(x, y, angles[is_hit], lengths[is_hit] + _DEPTH * self.resolution, self.resolution)
        passed = passed_cells(x, y, angles, lengths, self.resolution)
        self._add(np.vstack([passed, hits]), hits)

    def add_free_disc(self, x: float, y: float, radius: float) -> None:
        """Count the cells of a disc as free: a robot stands there."""
        steps = np.arange(-math.ceil(radius / self.resolution), math.ceil(radius / self.resolution) + 1)
        rows, columns = (offsets.ravel() for offsets in np.meshgrid(steps, steps, indexing="ij"))
        is_inside = np.hypot(rows, columns) * self.resolution <= radius
        middle = np.floor(np.array([y, x]) / self.resolution).astype(np.int64)
        self._add(np.column_stack([rows, columns])[is_inside] + middle, np.zeros((0, 2), dtype=np.int64))

    def forget(self, cells: Mask) -> None:
        """What was seen in these cells of the grid does not count any more: something there has moved."""
        self._log_odds[cells] = 0.0

    def _add(self, touched: Indexes, hits: Indexes) -> None:
        """Each cell counts once: as hit, if a ray ends in it, or else as passed."""
        if not len(touched):
            return
        lowest, highest = touched.min(axis=0), touched.max(axis=0)
        self._grow(lowest, highest)
        (row, column), (end_row, end_column) = lowest - self._corner, highest + 1 - self._corner
        touched_part = self._log_odds[row:end_row, column:end_column]
        change = np.zeros_like(touched_part)
        change[tuple((touched - lowest).T)] = _MISS
        change[tuple((hits - lowest).T)] = _HIT
        np.clip(touched_part + change, -_SUREST, _SUREST, out=touched_part)

    def _grow(self, lowest: Indexes, highest: Indexes) -> None:
        if not self._log_odds.size:
            self._corner = int(lowest[0]), int(lowest[1])
        shape = np.array(self._log_odds.shape)
        missing_low = np.maximum(np.array(self._corner) - lowest, 0)
        missing_high = np.maximum(highest + 1 - self._corner - shape, 0)
        if missing_low.any() or missing_high.any():
            before_cells, after_cells = (np.where(missing > 0, missing + _MARGIN, 0) for missing in (missing_low, missing_high))
            self._log_odds = np.pad(self._log_odds, [(int(low), int(high)) for low, high in zip(before_cells, after_cells, strict=True)])
            self._corner = self._corner[0] - int(before_cells[0]), self._corner[1] - int(before_cells[1])

    def grid(self) -> OccupancyGrid:
        """What is known now, in cells along the axes of the map."""
        states: States = np.full(self._log_odds.shape, Cell.UNKNOWN, dtype=np.int8)
        states[self._log_odds >= _OCCUPIED] = Cell.OCCUPIED
        states[self._log_odds <= _FREE] = Cell.FREE
        return OccupancyGrid(
            states=states, resolution=self.resolution, x=self._corner[1] * self.resolution, y=self._corner[0] * self.resolution
        )


def passed_cells(x: float, y: float, angles: npt.NDArray[np.float64], lengths: npt.NDArray[np.float64], resolution: float) -> Indexes:
    """The cells that rays pass before they end, row and column, in steps of half a cell."""
    if not len(angles):
        return np.zeros((0, 2), dtype=np.int64)
    steps = np.arange(0.0, float(lengths.max(initial=0.0)), resolution / 2)[:, None]
    is_before_end = steps < lengths - resolution / 2
    rows, columns = y + steps * np.sin(angles), x + steps * np.cos(angles)
    return _numbers(np.column_stack([rows[is_before_end], columns[is_before_end]]), resolution)


def _cells(x: float, y: float, angles: npt.NDArray[np.float64], distances: npt.NDArray[np.float64], resolution: float) -> Indexes:
    return _numbers(np.column_stack([y + distances * np.sin(angles), x + distances * np.cos(angles)]), resolution)


def _numbers(points: npt.NDArray[np.float64], resolution: float) -> Indexes:
    """The cells of points (n × 2: y and x, m), row and column."""
    return np.floor(points / resolution).astype(np.int64)

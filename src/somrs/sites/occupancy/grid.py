"""An occupancy grid: which cells of a floor are free, occupied or unknown, and where they are. Units are metres and radians."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import numpy as np
import numpy.typing as npt

States = npt.NDArray[np.int8]
Mask = npt.NDArray[np.bool_]
Points = npt.NDArray[np.float64]


class Cell(IntEnum):
    """What is known of a cell."""

    UNKNOWN = -1
    FREE = 0
    OCCUPIED = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class OccupancyGrid:
    """The cells of a floor.

    `states`: values of `Cell` by row and column; rows grow along the grid's own y, columns along its x. `resolution`: the side of a cell,
    m. `x`, `y`, `yaw`: the pose of the grid's corner, that of the first cell, on the map, m and rad.
    """

    states: States
    resolution: float
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.states.shape
        return rows, columns

    def mask(self, cell: Cell) -> Mask:
        """Which cells are in this state, by row and column."""
        mask: Mask = self.states == cell
        return mask

    def state_at(self, local: Points) -> States:
        """The states at points (n × 2, local coordinates, m); unknown outside of the grid."""
        columns, rows = np.floor(local / self.resolution).astype(int).T
        height, width = self.shape
        is_on_grid = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        states = np.full(len(local), Cell.UNKNOWN, dtype=np.int8)
        states[is_on_grid] = self.states[rows[is_on_grid], columns[is_on_grid]]
        return states

    def centres(self, mask: Mask) -> Points:
        """The middles of cells in local coordinates, n × 2, m."""
        rows, columns = np.nonzero(mask)
        middles: Points = np.asarray((np.column_stack([columns, rows]) + 0.5) * self.resolution, dtype=np.float64)
        return middles

    def to_map(self, local: Any) -> Points:
        """Points in local coordinates (n × 2, m) on the map."""
        points = np.asarray(local, dtype=float).reshape(-1, 2)
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        on_map: Points = points @ np.array([[cos, sin], [-sin, cos]]) + np.array([self.x, self.y])
        return on_map

    def to_local(self, points: Any) -> Points:
        """Points on the map (n × 2, m) in local coordinates."""
        shifted = np.asarray(points, dtype=float).reshape(-1, 2) - (self.x, self.y)
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        local: Points = shifted @ np.array([[cos, -sin], [sin, cos]])
        return local


def without_margins(grid: OccupancyGrid) -> OccupancyGrid:
    """The grid without the rows and columns around it of which nothing is known."""
    rows, columns = (np.flatnonzero((grid.states != Cell.UNKNOWN).any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return grid
    low, left = max(int(rows[0]) - 1, 0), max(int(columns[0]) - 1, 0)
    ((x, y),) = grid.to_map([(left * grid.resolution, low * grid.resolution)]).tolist()
    return replace(grid, states=grid.states[low : int(rows[-1]) + 2, left : int(columns[-1]) + 2], x=x, y=y)


def coarser(grid: OccupancyGrid, resolution: float) -> OccupancyGrid:
    """The grid in cells that are at least as large, m: a cell is occupied if a part of it is, or else free if a part of it is."""
    factor = math.ceil(resolution / grid.resolution - 1e-6)
    if factor < 2:
        return grid
    rows, columns = (math.ceil(length / factor) for length in grid.shape)
    padding = [(0, rows * factor - grid.shape[0]), (0, columns * factor - grid.shape[1])]
    padded = np.pad(grid.states, padding, constant_values=Cell.UNKNOWN)
    states = padded.reshape(rows, factor, columns, factor).max(axis=(1, 3))
    return replace(grid, states=states, resolution=grid.resolution * factor)

"""Where a robot can drive on an occupancy grid, and what is left to see: frontiers, where free cells touch unknown ones.

Yamauchi, "A frontier-based approach for autonomous exploration" (1997). Coordinates are those of the map, in metres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from somrs.sites.occupancy.building import cells_of
from somrs.sites.occupancy.grid import Cell, Mask, OccupancyGrid
from somrs.sites.plan import Box, Point

SHORTEST_FRONTIER = 0.35
"""What is shorter is a gap between rays, or too narrow to look into, m."""
VIEWING_DISTANCE = 1.0
"""A frontier is looked at from at most so far, m."""
_NEAR_CANDIDATES, _STRIDE = 200, 10
"""So many of the nearest cells from which something may be seen are tried, and of those farther away one of so many."""
_STEPS = ((0, 1, 1.0), (1, 0, 1.0), (1, 1, math.sqrt(2)), (1, -1, math.sqrt(2)))
"""Steps to half of the eight cells around one, with their lengths in cells."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frontier:
    """A stretch of free cells beside unknown ones: its middle, and its length in m. `way`: the points to drive through to look at it, the
    first is where the robot is; `distance`: their length, m."""

    middle: Point
    length: float
    way: list[Point]
    distance: float


class Ways:
    """The ways from a point over the free cells of a grid that are at least `clearance` from all others, and `berth` from the middles of
    `robots`, m, and that do not lead through `shut_doors`. Through `doorways`, they lead over cells that are `radius` from all others."""

    def __init__(
        self,
        grid: OccupancyGrid,
        start: Point,
        clearance: float,
        robots: Sequence[Point] = (),
        berth: float = 0.0,
        shut_doors: Sequence[Box] = (),
        doorways: Sequence[Box] = (),
        radius: float = 0.0,
    ) -> None:
        self.grid, self.start = grid, start
        self._free = grid.mask(Cell.FREE)
        distances = ndimage.distance_transform_edt(np.pad(self._free, 1))[1:-1, 1:-1] * grid.resolution
        self.is_open: Mask = distances > clearance
        for x, y in robots:
            self.is_open &= ~covered_cells(Box(x, y, 2 * berth, 2 * berth), grid)
        for doorway in doorways:
            self.is_open |= covered_cells(doorway, grid) & (distances > radius)
        for door in shut_doors:
            self.is_open &= ~covered_cells(door, grid, clearance)
        self._start_cell = self._cell_near(start)
        self.lengths, self._predecessors = shortest_ways(self.is_open, self._start_cell)

    def _cell_of(self, point: Point) -> tuple[int, int]:
        ((x, y),) = self.grid.to_local([point]).tolist()
        return math.floor(y / self.grid.resolution), math.floor(x / self.grid.resolution)

    def _cell_near(self, point: Point) -> tuple[int, int]:
        """The open cell nearest to a point; that of the point if none is."""
        row, column = self._cell_of(point)
        rows, columns = np.nonzero(self.is_open)
        if not len(rows):
            return row, column
        nearest = int(np.hypot(rows - row, columns - column).argmin())
        return int(rows[nearest]), int(columns[nearest])

    def frontiers(self, viewing_distance: float = VIEWING_DISTANCE) -> list[Frontier]:
        """The frontiers that can be looked at from at most so far, m; the nearest first."""
        unknown = ndimage.binary_dilation(self.grid.mask(Cell.UNKNOWN), np.ones((3, 3)))
        labels, _ = ndimage.label(self._free & unknown, structure=np.ones((3, 3)))
        is_reachable = np.isfinite(self.lengths)
        if not is_reachable.any():
            return []
        found_frontiers = []
        reach = math.ceil(viewing_distance / self.grid.resolution)
        for number, place in enumerate(ndimage.find_objects(labels), 1):
            rows, columns = np.nonzero(labels[place] == number)
            if len(rows) * self.grid.resolution < SHORTEST_FRONTIER:
                continue
            rows, columns = rows + place[0].start, columns + place[1].start
            nearest = int(np.hypot(rows - rows.mean(), columns - columns.mean()).argmin())
            middle = int(rows[nearest]), int(columns[nearest])
            view = self._view_of(middle, reach, is_reachable)
            if view is not None:
                way = self._way_to(view)
                found_frontiers.append(
                    Frontier(middle=self._point(middle), length=len(rows) * self.grid.resolution, way=way, distance=path_length(way))
                )
        return sorted(found_frontiers, key=lambda frontier: frontier.distance)

    def is_reachable(self, point: Point) -> bool:
        """Whether a way leads to the cell of a point."""
        row, column = self._cell_of(point)
        height, width = self.lengths.shape
        return 0 <= row < height and 0 <= column < width and bool(np.isfinite(self.lengths[row, column]))

    def view_of(self, point: Point, length: float, least: float, reach: float) -> Frontier | None:
        """From where a point is seen, at least `least` and at most `reach` from it, in m; None if it is not known to be free, or no way
        leads to where it is seen."""
        row, column = self._cell_of(point)
        height, width = self._free.shape
        if not (0 <= row < height and 0 <= column < width and self._free[row, column]):
            return None
        cells = math.ceil(reach / self.grid.resolution), math.ceil(least / self.grid.resolution)
        view = self._view_of((row, column), cells[0], np.isfinite(self.lengths), cells[1])
        if view is None:
            return None
        way = self._way_to(view)
        return Frontier(middle=point, length=length, way=way, distance=path_length(way))

    def _view_of(self, cell: tuple[int, int], reach: int, is_reachable: Mask, least: int = 0) -> tuple[int, int] | None:
        """The reachable cell from which a cell is seen, and that is the nearest to it, though `least` cells away; None if there is none
        within reach, in cells."""
        low_row, low_column = max(cell[0] - reach, 0), max(cell[1] - reach, 0)
        rows, columns = np.nonzero(is_reachable[low_row : cell[0] + reach + 1, low_column : cell[1] + reach + 1])
        distances = np.hypot(rows + low_row - cell[0], columns + low_column - cell[1])
        order = np.argsort(distances, kind="stable")
        order = order[(distances[order] >= least) & (distances[order] <= reach)]
        for index in np.concatenate([order[:_NEAR_CANDIDATES], order[_NEAR_CANDIDATES::_STRIDE]]):
            candidate = int(rows[index]) + low_row, int(columns[index]) + low_column
            if is_clear_line(self._free, candidate, cell):
                return candidate
        return None

    def _way_to(self, cell: tuple[int, int]) -> list[Point]:
        """The way to a reachable cell, with as few points as keep it clear."""
        width = self.is_open.shape[1]
        cells = [cell]
        while cells[-1] != self._start_cell:
            previous = int(self._predecessors[cells[-1][0] * width + cells[-1][1]])
            cells.append(divmod(previous, width))
        cells.reverse()
        points, index = [self.start], 0
        while index < len(cells) - 1:
            ahead = next(
                (later for later in range(len(cells) - 1, index + 1, -1) if is_clear_line(self.is_open, cells[index], cells[later])),
                index + 1,
            )
            points.append(self._point(cells[ahead]))
            index = ahead
        return points

    def _point(self, cell: tuple[int, int]) -> Point:
        ((x, y),) = self.grid.to_map([((cell[1] + 0.5) * self.grid.resolution, (cell[0] + 0.5) * self.grid.resolution)]).tolist()
        return x, y


def covered_cells(box: Box, grid: OccupancyGrid, margin: float = 0.0) -> Mask:
    """The cells that a rectangle of the map covers, or that are at most `margin` beside it, m."""
    ((x, y),) = grid.to_local([(box.x, box.y)]).tolist()
    return cells_of(replace(box, x=x, y=y, yaw=box.yaw - grid.yaw), grid, margin)


def shortest_ways(is_open: Mask, start: tuple[int, int]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int32]]:
    """The lengths of the shortest ways from a cell to all open cells, in cells, over the eight cells around each; infinity if there is
    none. And from which cell each way comes, as row × width + column."""
    height, width = is_open.shape
    numbers = np.arange(height * width).reshape(height, width)
    ends: list[tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], float]] = []
    for row_step, column_step, length in _STEPS:
        first = np.s_[: height - row_step, max(-column_step, 0) : width - max(column_step, 0)]
        second = np.s_[row_step:, max(column_step, 0) : width - max(-column_step, 0)]
        is_joined = is_open[first] & is_open[second]
        ends.append((numbers[first][is_joined], numbers[second][is_joined], length))
    starts, stops = np.concatenate([first for first, _, _ in ends]), np.concatenate([second for _, second, _ in ends])
    weights = np.concatenate([np.full(len(first), length) for first, _, length in ends])
    graph = coo_array((weights, (starts, stops)), shape=(height * width, height * width)).tocsr()
    if not is_open[start]:
        return np.full((height, width), math.inf), np.full(height * width, -1, dtype=np.int32)
    lengths, predecessors = dijkstra(graph, directed=False, indices=start[0] * width + start[1], return_predecessors=True)
    return lengths.reshape(height, width), predecessors


def is_clear_line(mask: Mask, start: tuple[int, int], end: tuple[int, int]) -> bool:
    """Whether all cells on a line between the middles of two cells are in the mask, in steps of half a cell."""
    count = 2 * max(abs(end[0] - start[0]), abs(end[1] - start[1])) + 1
    rows = np.rint(np.linspace(start[0], end[0], count)).astype(int)
    columns = np.rint(np.linspace(start[1], end[1], count)).astype(int)
    return bool(mask[rows, columns].all())


def path_length(points: Sequence[Point]) -> float:
    """The length of a way, m."""
    return sum(math.dist(start, end) for start, end in pairwise(points))

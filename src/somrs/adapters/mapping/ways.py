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
LONGEST_FRONTIER = 3.0
"""Of a frontier that is longer, no more than this is counted as seen in one look, m."""
NEARBY, _STRIDE = 1.0, 5
"""Stands in the cells so near to a frontier are tried, m, and of those farther away one of so many in each direction."""
_ELSEWHERE = 0.5
"""A frontier is looked at again from a stand that is farther from the earlier ones than this share of its distance to the frontier."""
_EFFORT = 1.5
"""What a look costs, as the length of a way, m."""
_STEPS = ((0, 1, 1.0), (1, 0, 1.0), (1, 1, math.sqrt(2)), (1, -1, math.sqrt(2)))
"""Steps to half of the eight cells around one, with their lengths in cells."""

Cells = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Frontier:
    """A stretch of free cells beside unknown ones: its middle, and its length in m. `reach`: from how far away it may be looked at, m;
    `tried_stands`: from where it was looked at in vain."""

    middle: Point
    length: float
    reach: float = math.inf
    tried_stands: tuple[Point, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """Where to look from. `way`: the points to drive through, the first is where the robot is; `distance`: their length, m; `frontiers`:
    those of which the middles are in sight from there."""

    way: list[Point]
    distance: float
    frontiers: tuple[Frontier, ...] = ()

    @property
    def stand(self) -> Point:
        """Where the robot looks."""
        return self.way[-1]


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

    def frontiers(self) -> list[Frontier]:
        """The frontiers of the grid, also those to which no way leads."""
        unknown = ndimage.binary_dilation(self.grid.mask(Cell.UNKNOWN), np.ones((3, 3)))
        labels, _ = ndimage.label(self._free & unknown, structure=np.ones((3, 3)))
        found_frontiers = []
        for number, place in enumerate(ndimage.find_objects(labels), 1):
            rows, columns = np.nonzero(labels[place] == number)
            if len(rows) * self.grid.resolution < SHORTEST_FRONTIER:
                continue
            rows, columns = rows + place[0].start, columns + place[1].start
            nearest = int(np.hypot(rows - rows.mean(), columns - columns.mean()).argmin())
            middle = self._point((int(rows[nearest]), int(columns[nearest])))
            found_frontiers.append(Frontier(middle=middle, length=len(rows) * self.grid.resolution))
        return found_frontiers

    def best_view(self, frontiers: Sequence[Frontier]) -> View | None:
        """From where most of these frontiers is seen for the effort of coming there; None if none can be seen.

        After González-Baños and Latombe, "Navigation strategies for exploring indoor environments" (2002).
        """
        gains, stands = np.zeros(self.grid.shape), [self._stands(frontier) for frontier in frontiers]
        for frontier, (rows, columns) in zip(frontiers, stands, strict=True):
            gains[rows, columns] += min(frontier.length, LONGEST_FRONTIER)
        if not gains.any():
            return None
        values = gains / (self.lengths * self.grid.resolution + _EFFORT)
        row, column = divmod(int(values.argmax()), self.grid.shape[1])
        way = self._way_to((row, column))
        frontiers_seen = [
            frontier for frontier, cells in zip(frontiers, stands, strict=True) if ((cells[0] == row) & (cells[1] == column)).any()
        ]
        return View(way=way, distance=path_length(way), frontiers=tuple(frontiers_seen))

    def _stands(self, frontier: Frontier) -> tuple[Cells, Cells]:
        """The cells from which a frontier is seen, of those that are tried, by rows and columns."""
        cell = self._cell_of(frontier.middle)
        rows, columns = self._reachable_near(cell, 0.0, frontier.reach)
        distances = np.hypot(rows - cell[0], columns - cell[1])
        is_nearby = distances * self.grid.resolution <= NEARBY
        is_candidate = is_nearby | ((rows % _STRIDE == 0) & (columns % _STRIDE == 0))
        for row, column in map(self._cell_of, frontier.tried_stands):
            is_candidate &= np.hypot(rows - row, columns - column) > _ELSEWHERE * distances
        rows, columns = rows[is_candidate], columns[is_candidate]
        is_in_sight = clear_lines(self._free, rows, columns, cell)
        return rows[is_in_sight], columns[is_in_sight]

    def _reachable_near(self, cell: tuple[int, int], closest: float, reach: float) -> tuple[Cells, Cells]:
        """The cells to which a way leads at least `closest` and at most `reach` from a cell, in m: rows and columns."""
        cells = math.ceil(reach / self.grid.resolution)
        low_row, low_column = max(cell[0] - cells, 0), max(cell[1] - cells, 0)
        rows, columns = np.nonzero(np.isfinite(self.lengths[low_row : cell[0] + cells + 1, low_column : cell[1] + cells + 1]))
        rows, columns = rows + low_row, columns + low_column
        distances = np.hypot(rows - cell[0], columns - cell[1]) * self.grid.resolution
        is_within_reach = (distances >= closest) & (distances <= reach)
        return rows[is_within_reach], columns[is_within_reach]

    def is_reachable(self, point: Point) -> bool:
        """Whether a way leads to the cell of a point."""
        row, column = self._cell_of(point)
        height, width = self.lengths.shape
        return 0 <= row < height and 0 <= column < width and bool(np.isfinite(self.lengths[row, column]))

    def view_of(self, point: Point, closest: float, reach: float) -> View | None:
        """The nearest stand to a point from which it is seen, at least `closest` and at most `reach` from it, in m; None if it is not known
        to be free, or no way leads to where it is seen."""
        row, column = self._cell_of(point)
        height, width = self._free.shape
        if not (0 <= row < height and 0 <= column < width and self._free[row, column]):
            return None
        rows, columns = self._reachable_near((row, column), closest, reach)
        is_in_sight = clear_lines(self._free, rows, columns, (row, column))
        if not is_in_sight.any():
            return None
        rows, columns = rows[is_in_sight], columns[is_in_sight]
        nearest = int(np.hypot(rows - row, columns - column).argmin())
        way = self._way_to((int(rows[nearest]), int(columns[nearest])))
        return View(way=way, distance=path_length(way))

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
    """Whether all cells on a line between the middles of two cells are in the mask, in steps of at most half a cell."""
    return bool(clear_lines(mask, np.array([start[0]]), np.array([start[1]]), end)[0])


def clear_lines(mask: Mask, rows: Cells, columns: Cells, end: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """The same for lines from many cells to one."""
    steps = 2 * int(max(np.abs(rows - end[0]).max(initial=0), np.abs(columns - end[1]).max(initial=0)))
    shares = np.linspace(0.0, 1.0, steps + 1)
    line_rows = np.rint(rows[:, None] + (end[0] - rows)[:, None] * shares).astype(np.intp)
    line_columns = np.rint(columns[:, None] + (end[1] - columns)[:, None] * shares).astype(np.intp)
    is_clear: npt.NDArray[np.bool_] = np.all(mask[line_rows, line_columns], axis=1)
    return is_clear


def path_length(points: Sequence[Point]) -> float:
    """The length of a way, m."""
    return sum(math.dist(start, end) for start, end in pairwise(points))

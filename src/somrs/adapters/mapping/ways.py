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
from scipy.sparse import csr_array
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
_STEPS = tuple((row, column, math.hypot(row, column)) for row in (-1, 0, 1) for column in (-1, 0, 1) if row or column)
"""Steps to the eight cells around one, with their lengths in cells."""
_HALF_SQUARE = math.sqrt(0.5)
"""The distance of the corners of a square of 1 m from its middle, m."""
_OFF_START = 0.5
"""How far the cell at which ways begin is from the robot at most, as a rule, m."""
_COARSE = 8
"""Of the points along a line, one of so many is tried first."""
_MARGIN = 6.0
"""What is farther than the longest way and this matters neither to the ways nor to what is seen from them, m."""

Cells = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Frontier:
    """A stretch of free cells beside unknown ones: its middle, and its length in m. `reach`: from how far away it may be looked at, m;
    `tried_stands`: from where it was looked at in vain."""

    middle: Point
    length: float
    reach: float = math.inf
    tried_stands: tuple[Point, ...] = ()

    @property
    def gain(self) -> float:
        """How much of it is seen in one look, m."""
        return min(self.length, LONGEST_FRONTIER)


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """Where to look from. `way`: the points to drive through, the first is where the robot is; `distance`: their length, m; `frontiers`:
    those of which the middles are in sight from there; `value`: their length for the effort of coming there."""

    way: list[Point]
    distance: float
    frontiers: tuple[Frontier, ...] = ()
    value: float = 0.0

    @property
    def stand(self) -> Point:
        """Where the robot looks."""
        return self.way[-1]


class Ways:
    """The ways from a point over the free cells of a grid that are at least `clearance` from all others, and `berth` from the middles of
    `robots`, m, and that do not lead through `shut_doors`. Through `doorways`, they lead over cells that are `radius` from all others. Only
    those up to a length of `reach` are looked for, m."""

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
        reach: float = math.inf,
    ) -> None:
        self.start, self._reach = start, reach
        self.grid = grid = part_around(grid, start, reach + _MARGIN)
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
        self.lengths, self._predecessors = shortest_ways(self.is_open, self._start_cell, reach / grid.resolution)

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

    def best_view(self, frontiers: Sequence[Frontier]) -> View | None:
        """From where most of these frontiers is seen for the effort of coming there; None if none can be seen.

        After González-Baños and Latombe, "Navigation strategies for exploring indoor environments" (2002).
        """
        frontiers = [
            frontier for frontier in frontiers if math.dist(self.start, frontier.middle) <= self._reach + frontier.reach + _OFF_START
        ]
        gains, stands = np.zeros(self.grid.shape), [self._stands(frontier) for frontier in frontiers]
        for frontier, (rows, columns) in zip(frontiers, stands, strict=True):
            gains[rows, columns] += frontier.gain
        if not gains.any():
            return None
        values = gains / (self.lengths * self.grid.resolution + _EFFORT)
        row, column = divmod(int(values.argmax()), self.grid.shape[1])
        way = self._way_to((row, column))
        frontiers_seen = [
            frontier for frontier, cells in zip(frontiers, stands, strict=True) if ((cells[0] == row) & (cells[1] == column)).any()
        ]
        return View(way=way, distance=path_length(way), frontiers=tuple(frontiers_seen), value=float(values[row, column]))

    def _stands(self, frontier: Frontier) -> tuple[Cells, Cells]:
        """The cells from which a frontier is seen, of those that are tried, by rows and columns."""
        cell = self._cell_of(frontier.middle)
        rows, columns = self._reachable_near(cell, 0.0, frontier.reach, is_sparse=True)
        distances = np.hypot(rows - cell[0], columns - cell[1])
        is_candidate = np.ones(len(rows), dtype=bool)
        for row, column in map(self._cell_of, frontier.tried_stands):
            is_candidate &= np.hypot(rows - row, columns - column) > _ELSEWHERE * distances
        rows, columns = rows[is_candidate], columns[is_candidate]
        is_in_sight = clear_lines(self._free, rows, columns, cell)
        return rows[is_in_sight], columns[is_in_sight]

    def _reachable_near(self, cell: tuple[int, int], closest: float, reach: float, *, is_sparse: bool = False) -> tuple[Cells, Cells]:
        """The cells to which a way leads at least `closest` and at most `reach` from a cell, in m: rows and columns. `is_sparse`: only
        those that are tried as stands."""
        height, width = self.lengths.shape
        cells = math.ceil(min(reach / self.grid.resolution, height + width))
        first_row, first_column = max(cell[0] - cells, 0), max(cell[1] - cells, 0)
        is_candidate = np.isfinite(self.lengths[first_row : max(cell[0] + cells + 1, 0), first_column : max(cell[1] + cells + 1, 0)])
        if is_sparse:
            nearby = math.floor(NEARBY / self.grid.resolution)
            is_tried = np.zeros_like(is_candidate)
            is_tried[-first_row % _STRIDE :: _STRIDE, -first_column % _STRIDE :: _STRIDE] = True
            rows, columns = np.ogrid[first_row : first_row + is_candidate.shape[0], first_column : first_column + is_candidate.shape[1]]
            is_tried |= (rows - cell[0]) ** 2 + (columns - cell[1]) ** 2 <= nearby**2
            is_candidate &= is_tried
        rows, columns = np.nonzero(is_candidate)
        rows, columns = rows + first_row, columns + first_column
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


def part_around(grid: OccupancyGrid, point: Point, reach: float) -> OccupancyGrid:
    """The part of a grid that is at most so far from a point along its rows and columns, m. The cells tried as stands stay the same."""
    ((x, y),) = grid.to_local([point]).tolist()
    low, high = ([(value + sign * reach) / grid.resolution for value in (y, x)] for sign in (-1, 1))
    first_row, first_column = (math.floor(max(value, 0.0)) // _STRIDE * _STRIDE for value in low)
    end_row, end_column = (math.ceil(max(min(value, size), 0.0)) for value, size in zip(high, grid.shape, strict=True))
    ((corner_x, corner_y),) = grid.to_map([(first_column * grid.resolution, first_row * grid.resolution)]).tolist()
    return replace(grid, states=grid.states[first_row:end_row, first_column:end_column], x=corner_x, y=corner_y)


def frontiers_of(grid: OccupancyGrid) -> list[Frontier]:
    """The frontiers of a grid, also those to which no way leads."""
    is_frontier = grid.mask(Cell.FREE) & _with_neighbours(grid.mask(Cell.UNKNOWN))
    labels, count = ndimage.label(is_frontier, structure=np.ones((3, 3)))
    rows, columns = np.nonzero(is_frontier)
    order = np.argsort(labels[rows, columns], kind="stable")
    ends = np.cumsum(np.bincount(labels[rows, columns], minlength=count + 1))
    frontiers: list[Frontier] = []
    for start, end in pairwise(ends.tolist()):
        length = (end - start) * grid.resolution
        if length < SHORTEST_FRONTIER:
            continue
        cells = np.column_stack([rows, columns])[order[start:end]]
        nearest = cells[int(np.hypot(*(cells - cells.mean(axis=0)).T).argmin())]
        ((x, y),) = grid.to_map([(nearest[::-1] + 0.5) * grid.resolution]).tolist()
        frontiers.append(Frontier(middle=(x, y), length=length))
    return frontiers


def _with_neighbours(mask: Mask) -> Mask:
    """The cells of a mask and the eight around each."""
    beside_rows = mask.copy()
    beside_rows[1:] |= mask[:-1]
    beside_rows[:-1] |= mask[1:]
    neighbours = beside_rows.copy()
    neighbours[:, 1:] |= beside_rows[:, :-1]
    neighbours[:, :-1] |= beside_rows[:, 1:]
    return neighbours


def longest_worthwhile(frontiers: Sequence[Frontier], start: Point, value: float) -> float:
    """No view of these frontiers at the end of a way from the start that is longer than this is worth more than `value`, m.

    The stands are in squares of 1 m: from none in a square is more seen than all frontiers that are not too far from it.
    """
    middles = np.array([frontier.middle for frontier in frontiers])
    gains, reaches = np.array([frontier.gain for frontier in frontiers]), np.array([frontier.reach for frontier in frontiers])
    low, high = (middles - reaches[:, None]).min(axis=0), (middles + reaches[:, None]).max(axis=0) + 1.0
    squares = np.stack(np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1])), axis=-1).reshape(-1, 2)
    distances = np.hypot(squares[:, 0, None] - middles[:, 0], squares[:, 1, None] - middles[:, 1])
    longest = ((distances <= reaches + _HALF_SQUARE) @ gains) / value - _EFFORT
    is_near = np.hypot(*(squares - start).T) - _HALF_SQUARE - _OFF_START <= longest
    return float(longest[is_near].max(initial=0.0))


def shortest_ways(
    is_open: Mask, start: tuple[int, int], longest: float = math.inf
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int32]]:
    """The lengths of the shortest ways from a cell to all open cells, in cells, over the eight cells around each; infinity if there is none
    that is at most so long. And from which cell each way comes, as row × width + column."""
    height, width = is_open.shape
    all_lengths, all_predecessors = np.full(height * width, math.inf), np.full(height * width, -1, dtype=np.int32)
    if not (0 <= start[0] < height and 0 <= start[1] < width and is_open[start]):
        return all_lengths.reshape(height, width), all_predecessors
    cells = np.flatnonzero(is_open)
    numbers = np.full((height + 2, width + 2), -1, dtype=np.int32)
    numbers[1:-1, 1:-1][is_open] = np.arange(len(cells), dtype=np.int32)
    places = cells + 2 * (cells // width) + width + 3  # the same cells with a margin around
    neighbours = numbers.ravel()[places[:, None] + [row * (width + 2) + column for row, column, _ in _STEPS]]
    is_joined = neighbours >= 0
    weights = np.broadcast_to([length for _, _, length in _STEPS], neighbours.shape)[is_joined]
    ends = np.concatenate([[0], np.cumsum(is_joined.sum(axis=1))])
    graph = csr_array((weights, neighbours[is_joined], ends), shape=(len(cells), len(cells)))
    lengths, predecessors = dijkstra(graph, indices=int(numbers[start[0] + 1, start[1] + 1]), return_predecessors=True, limit=longest)
    all_lengths[cells] = lengths
    all_predecessors[cells] = np.where(predecessors >= 0, cells[np.maximum(predecessors, 0)], -1)
    return all_lengths.reshape(height, width), all_predecessors


def is_clear_line(mask: Mask, start: tuple[int, int], end: tuple[int, int]) -> bool:
    """Whether all cells on a line between the middles of two cells are in the mask, in steps of at most half a cell."""
    return bool(clear_lines(mask, np.array([start[0]]), np.array([start[1]]), end)[0])


def clear_lines(mask: Mask, rows: Cells, columns: Cells, end: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """The same for lines from many cells to one."""
    steps = 2 * int(max(np.abs(rows - end[0]).max(initial=0), np.abs(columns - end[1]).max(initial=0)))
    shares = np.linspace(0.0, 1.0, steps + 1)
    is_clear = np.ones(len(rows), dtype=bool)
    for points in (shares[::_COARSE], shares):  # most lines that are not clear are found out by a few points
        remaining = np.flatnonzero(is_clear)
        line_rows = np.rint(rows[remaining, None] + (end[0] - rows[remaining])[:, None] * points).astype(np.intp)
        line_columns = np.rint(columns[remaining, None] + (end[1] - columns[remaining])[:, None] * points).astype(np.intp)
        is_clear[remaining] = np.all(mask[line_rows, line_columns], axis=1)
    return is_clear


def path_length(points: Sequence[Point]) -> float:
    """The length of a way, m."""
    return sum(math.dist(start, end) for start, end in pairwise(points))

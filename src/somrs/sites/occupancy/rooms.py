"""Divides the free cells of an occupancy grid into rooms, at their doors.

A room is where a cell is farther from walls than the cells around it; a door is the narrowest place between two of them, if it is narrow
enough. This is a watershed of the distance from walls, from the widest to the narrowest: basins that meet where it is wide become one.
Coordinates are the grid's own, in metres.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from somrs.sites.occupancy.grid import Mask
from somrs.sites.plan import Point

Labels = npt.NDArray[np.int32]
Floats = npt.NDArray[np.float64]
Cells = npt.NDArray[np.intp]

WIDEST_DOOR = 1.7
"""Width of the widest door, m."""
NARROWEST_DOOR = 0.5
"""Width of the narrowest door, m: what is narrower was not seen well, or robots do not pass it."""
_NARROWING = 0.75
"""A door is at most so wide, relative to the rooms on both of its sides."""
SMALLEST_ROOM = 1.0
"""Area of the smallest room, m²."""
_EIGHT = np.ones((3, 3))


@dataclass(frozen=True, slots=True, kw_only=True)
class Doorway:
    """Where two rooms touch: their numbers, the middle of the passage, its width (m), and the direction across it, along the wall (rad)."""

    rooms: tuple[int, int]
    middle: Point
    width: float
    yaw: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Rooms:
    """`labels`: the number of the room of each free cell, from 1; 0: none. `doorways`: where they touch. `half_widths`: the distance from
    walls in the middle of each room, m."""

    labels: Labels
    doorways: list[Doorway]
    half_widths: dict[int, float]

    @property
    def numbers(self) -> list[int]:
        return [int(number) for number in np.unique(self.labels) if number]

    def united(self, first: int, second: int) -> Rooms:
        """The rooms, with the second of these as a part of the first."""
        labels = np.where(self.labels == second, np.int32(first), self.labels)
        half_widths = {number: width for number, width in self.half_widths.items() if number != second}
        half_widths[first] = max(self.half_widths[first], self.half_widths[second])
        doorways = [replace(doorway, rooms=_renumbered(doorway.rooms, second, first)) for doorway in self.doorways]
        return Rooms(labels=labels, doorways=[door for door in doorways if door.rooms[0] != door.rooms[1]], half_widths=half_widths)


def _renumbered(rooms: tuple[int, int], old: int, new: int) -> tuple[int, int]:
    first, second = sorted(new if number == old else number for number in rooms)
    return first, second


def find_rooms(free: Mask, resolution: float) -> Rooms:
    """The rooms among the free cells. `resolution`: the side of a cell, m."""
    padded = np.pad(free, 1)
    distances = ndimage.distance_transform_edt(padded) * resolution
    labels = segmented(distances, resolution)
    labels = _without_small(labels, round(SMALLEST_ROOM / resolution**2))[1:-1, 1:-1]
    distances = distances[1:-1, 1:-1]
    numbers = [int(number) for number in np.unique(labels) if number]
    half_widths = {number: float(width) for number, width in zip(numbers, ndimage.maximum(distances, labels, numbers), strict=True)}
    return Rooms(labels=labels, doorways=list(_doorways(labels, distances, resolution)), half_widths=half_widths)


def segmented(distances: Floats, step: float) -> Labels:
    """The basins of a map of distances from walls (m, 0 in walls and along the edge), by the levels of `step`, the highest first.

    Two basins that meet at a level become one, unless it is a door.
    """
    division = _Division(distances.shape)
    values = distances.ravel()
    cells = np.flatnonzero(values > 0)
    cells = cells[np.argsort(-values[cells], kind="stable")]
    heights, start = -values[cells], 0
    for level in np.arange(math.floor(distances.max() / step), 0, -1) * step:
        end = int(np.searchsorted(heights, 1e-9 - level, side="right"))
        if end > start:
            division.add(cells[start:end], float(level))
        start = end
    return division.labels.reshape(distances.shape)


class _Division:
    """The basins of the levels so far. Cells are numbered row by row; those along the edge are in no basin."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = shape
        self.labels: Labels = np.zeros(math.prod(shape), dtype=np.int32)
        self._peaks: dict[int, float] = {}
        self._separate: set[frozenset[int]] = set()
        width = shape[1]
        self._around = np.array([row * width + column for row in (-1, 0, 1) for column in (-1, 0, 1) if row or column])

    def add(self, cells: Cells, level: float) -> None:
        """Add the cells of a level, m."""
        remaining = self._flood(cells)
        if len(remaining):
            self._add_peaks(remaining, level)
        self._join(cells, level)

    def _flood(self, cells: Cells) -> Cells:
        """Spread the labels over cells, each from the nearest along them. Returns those that they do not reach."""
        while len(cells):
            labels = self.labels[cells[:, None] + self._around].max(axis=1)
            is_reached = labels > 0
            if not is_reached.any():
                break
            self.labels[cells[is_reached]] = labels[is_reached]
            cells = cells[~is_reached]
        return cells

    def _add_peaks(self, cells: Cells, level: float) -> None:
        """Begin a basin with each part of these cells."""
        rows, columns = np.divmod(cells, self._shape[1])
        first_row, first_column = int(rows.min()), int(columns.min())
        mask = np.zeros((int(rows.max()) - first_row + 1, int(columns.max()) - first_column + 1), dtype=bool)
        mask[rows - first_row, columns - first_column] = True
        parts, count = ndimage.label(mask, structure=_EIGHT)
        self.labels[cells] = len(self._peaks) + parts[rows - first_row, columns - first_column]
        self._peaks |= {len(self._peaks) + number: level for number in range(1, count + 1)}

    def _join(self, cells: Cells, level: float) -> None:
        """Make one of basins that meet in these cells, unless it is at a door."""
        meeting = self._meeting(cells)
        while undecided := meeting - self._separate:
            first, second = sorted(min(undecided, key=sorted))
            if is_door(level, self._peaks[first], self._peaks[second]):
                self._separate.add(frozenset((first, second)))
                continue
            larger, dropped = (first, second) if self._peaks[first] >= self._peaks[second] else (second, first)
            self.labels[self.labels == dropped] = larger
            meeting, self._separate = (_renamed(pairs, dropped, larger) for pairs in (meeting, self._separate))

    def _meeting(self, cells: Cells) -> set[frozenset[int]]:
        """The pairs of basins that touch in these cells."""
        neighbours, own_labels = self.labels[cells[:, None] + self._around], self.labels[cells]
        rows, columns = np.nonzero((neighbours > 0) & (neighbours != own_labels[:, None]))
        codes = np.unique(own_labels[rows].astype(np.int64) * 2**32 + neighbours[rows, columns])
        return {frozenset((int(code >> 32), int(code & 0xFFFFFFFF))) for code in codes}


def _renamed(pairs: set[frozenset[int]], old: int, new: int) -> set[frozenset[int]]:
    """The pairs of basins after one has become a part of another one."""
    renamed = (frozenset(new if number == old else number for number in pair) for pair in pairs)
    return {pair for pair in renamed if len(pair) == 2}


def is_door(half_width: float, first_peak: float, second_peak: float) -> bool:
    """Whether a narrow place is a door: the distances from walls there and in the middles of the rooms on its sides, m."""
    return half_width <= WIDEST_DOOR / 2 and is_narrow(half_width, first_peak, second_peak)


def is_narrow(half_width: float, first_peak: float, second_peak: float) -> bool:
    """Whether a place is narrow beside the rooms on its sides, by the distances from walls there and in their middles, m."""
    return half_width <= _NARROWING * min(first_peak, second_peak)


def _meeting(labels: Labels) -> set[frozenset[int]]:
    """The pairs of labels that touch."""
    pairs: set[frozenset[int]] = set()
    for first, second in _shifts(labels):
        touches = (first != second) & (first > 0) & (second > 0)
        codes = np.unique(first[touches].astype(np.int64) * 2**32 + second[touches])
        pairs |= {frozenset((int(code >> 32), int(code & 0xFFFFFFFF))) for code in codes}
    return pairs


def _shifts(labels: Labels) -> Iterator[tuple[Labels, Labels]]:
    """The labels beside those of the next column, the next row, and both diagonals."""
    yield labels[:, :-1], labels[:, 1:]
    yield labels[:-1], labels[1:]
    yield labels[:-1, :-1], labels[1:, 1:]
    yield labels[:-1, 1:], labels[1:, :-1]


def _without_small(labels: Labels, least_cells: int) -> Labels:
    """The labels without the rooms that have too few cells: these belong to the room that they touch most, or to none."""
    labels = labels.copy()
    while True:
        counts = np.bincount(labels.ravel())
        small = [number for number in range(1, len(counts)) if 0 < counts[number] < least_cells]
        if not small:
            return labels
        number = min(small, key=lambda number: int(counts[number]))
        rim = ndimage.binary_dilation(labels == number, _EIGHT) & (labels != number) & (labels > 0)
        labels[labels == number] = int(np.bincount(labels[rim]).argmax()) if rim.any() else 0


def _doorways(labels: Labels, distances: Floats, resolution: float) -> Iterator[Doorway]:
    """The places where rooms touch: each contiguous stretch of cells of one room beside the other."""
    for pair in sorted(tuple(sorted(pair)) for pair in _meeting(labels)):
        first, second = pair
        is_first, is_second = labels == first, labels == second
        rim = (is_first & ndimage.binary_dilation(is_second, _EIGHT)) | (is_second & ndimage.binary_dilation(is_first, _EIGHT))
        stretches, count = ndimage.label(rim, structure=_EIGHT)
        for number in range(1, count + 1):
            rows, columns = np.nonzero(stretches == number)
            half_width = float(distances[rows, columns].max())
            if 2 * half_width < NARROWEST_DOOR:
                continue
            cells = (np.column_stack([columns, rows]) + 0.5) * resolution
            middle = cells.mean(axis=0)
            _, _, axes = np.linalg.svd(cells - middle, full_matrices=False)
            yaw = math.remainder(math.atan2(axes[0][1], axes[0][0]), math.pi)
            yield Doorway(rooms=(first, second), middle=(float(middle[0]), float(middle[1])), width=2 * half_width, yaw=yaw)


def outline_of(mask: Mask, resolution: float, tolerance: float) -> list[Point]:
    """The outline of the largest part of a mask, in local coordinates: a polygon that is at most `tolerance` from the cells' edges, m.

    Holes are left out.
    """
    parts, count = ndimage.label(np.pad(mask, 1))
    if not count:
        return []
    largest = int(np.bincount(parts[parts > 0]).argmax())
    corners = _traced(ndimage.binary_fill_holes(parts == largest))
    return simplified([((column - 1) * resolution, (row - 1) * resolution) for row, column in corners], tolerance)


def _traced(mask: Mask) -> list[tuple[int, int]]:
    """The corners of the cells along the edge of a part without holes, counter-clockwise, with the part at the left: row, column."""
    row, column = (int(index) for index in np.argwhere(mask)[0])
    start, heading = (row, column), (0, 1)  # along the lower edge of the lowest cell
    position, corners = start, list[tuple[int, int]]()
    while True:
        corners.append(position)
        position = position[0] + heading[0], position[1] + heading[1]
        if position == start:
            return corners
        (dr, dc), (r, c) = heading, position
        if not mask[_cell(r, c, dr, dc, 1)]:
            heading = dc, -dr  # to the left
        elif mask[_cell(r, c, dr, dc, -1)]:
            heading = -dc, dr  # to the right


def _cell(row: int, column: int, dr: int, dc: int, side: int) -> tuple[int, int]:
    """The cell ahead of a corner, to the left (1) or the right (-1) of the heading."""
    # Left of a heading (dr, dc) is (dc, -dr): rows grow upward, columns to the right.
    lr, lc = dc * side, -dr * side
    return row + (dr + lr - 1) // 2, column + (dc + lc - 1) // 2


def simplified(points: list[Point], tolerance: float) -> list[Point]:
    """A closed polygon with as few of its corners as keep it within the tolerance (Douglas and Peucker)."""
    if len(points) < 4:
        return points
    array = np.array(points)
    opposite = int(np.hypot(*(array - array[0]).T).argmax())
    corners = {0, opposite}
    stack = [(0, opposite), (opposite, len(points))]
    closed = np.vstack([array, array[:1]])
    while stack:
        low, high = stack.pop()
        if high - low < 2:
            continue
        start, end = closed[low], closed[high]
        chord = end - start
        length = float(np.hypot(*chord)) or 1.0
        aside = np.abs((closed[low + 1 : high, 0] - start[0]) * chord[1] - (closed[low + 1 : high, 1] - start[1]) * chord[0]) / length
        farthest = int(aside.argmax())
        if aside[farthest] > tolerance:
            corners.add(low + 1 + farthest)
            stack += [(low, low + 1 + farthest), (low + 1 + farthest, high)]
    return [points[index] for index in sorted(corners)]

"""Finds openings in walls: gaps between the ends of two that go on in the same direction, through which the floor is free.

Coordinates are the grid's own, in metres.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from somrs.sites.occupancy.corners import gap_between, goes_on
from somrs.sites.occupancy.grid import Cell, OccupancyGrid
from somrs.sites.occupancy.rooms import NARROWEST_DOOR, Rooms, is_narrow
from somrs.sites.plan import Box

WIDEST_OPENING = 4.0
"""Width of the widest opening between the ends of two walls that may part rooms, m."""
_FREE = 0.9
"""Share of the cells between the ends that has to be free."""
_BESIDE = 3
"""So many cells beside a partition are those of the rooms that it parts."""


def find_openings(walls: Sequence[Box], grid: OccupancyGrid) -> list[Box]:
    """The openings between the ends of walls, each as the rectangle that would close it."""
    return [*_openings(walls, grid)]


def _openings(walls: Sequence[Box], grid: OccupancyGrid) -> Iterator[Box]:
    for wall, partner in combinations(walls, 2):
        if math.dist((wall.x, wall.y), (partner.x, partner.y)) > wall.reach + partner.reach + WIDEST_OPENING:
            continue
        opening = gap_between(wall, partner)
        if not NARROWEST_DOOR <= opening.width <= WIDEST_OPENING or not (goes_on(wall, opening) and goes_on(partner, opening)):
            continue
        offsets = np.arange((grid.resolution - opening.width) / 2, opening.width / 2, grid.resolution / 2)[2:-2]
        states = grid.state_at(np.array([opening.world((float(offset), 0.0)) for offset in offsets]))
        if float(np.mean(states == Cell.FREE)) >= _FREE:
            yield opening


def without_wide(rooms: Rooms, openings: Sequence[Box], grid: OccupancyGrid) -> tuple[Rooms, list[Box]]:
    """The rooms that openings have parted, with those as one between which an opening is not narrow beside them; and the openings that
    still part rooms."""
    kept: list[Box] = []
    for opening in openings:
        pair = rooms_beside(opening, rooms, grid)
        if pair is None:
            continue
        if is_narrow(opening.width / 2, *(rooms.half_widths[number] for number in pair)):
            kept.append(opening)
        else:
            rooms = rooms.united(*pair)
    return rooms, kept


def rooms_beside(partition: Box, rooms: Rooms, grid: OccupancyGrid) -> tuple[int, int] | None:
    """The numbers of the two rooms that a rectangle between them parts; None if it parts none."""
    numbers = [_room_beside(partition, side, rooms, grid) for side in (-1, 1)]
    return (min(numbers), max(numbers)) if 0 not in numbers and numbers[0] != numbers[1] else None


def _room_beside(partition: Box, side: int, rooms: Rooms, grid: OccupancyGrid) -> int:
    """The room of most of the cells along a side of a rectangle; 0: none."""
    distance = side * (partition.depth / 2 + _BESIDE * grid.resolution)
    offsets = np.arange(-0.4 * partition.width, 0.4 * partition.width, grid.resolution)
    points = np.array([partition.world((float(offset), distance)) for offset in offsets])
    columns, rows = np.floor(points / grid.resolution).astype(int).T
    height, width = grid.shape
    is_inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    return int(np.bincount(rooms.labels[rows[is_inside], columns[is_inside]], minlength=1).argmax())

"""Ways over free cells, against a plain twin, and frontiers."""

from __future__ import annotations

import heapq
import math
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from somrs.adapters.mapping.ways import (
    Frontier,
    Ways,
    clear_lines,
    frontiers_of,
    is_clear_line,
    longest_worthwhile,
    path_length,
    shortest_ways,
)
from somrs.sites.occupancy.grid import Cell, OccupancyGrid
from somrs.sites.plan import Box


def plain_lengths(is_open: np.ndarray, start: tuple[int, int]) -> np.ndarray:
    """Dijkstra's algorithm, cell by cell."""
    lengths = np.full(is_open.shape, math.inf)
    queue = [(0.0, start)] if is_open[start] else []
    while queue:
        length, (row, column) = heapq.heappop(queue)
        if length >= lengths[row, column]:
            continue
        lengths[row, column] = length
        for row_step, column_step in product((-1, 0, 1), repeat=2):
            r, c = row + row_step, column + column_step
            if (row_step or column_step) and 0 <= r < is_open.shape[0] and 0 <= c < is_open.shape[1] and is_open[r, c]:
                heapq.heappush(queue, (length + math.hypot(row_step, column_step), (r, c)))
    return lengths


@given(
    is_open=arrays.arrays(bool, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.sampled_from([True, True, False])),
    data=st.data(),
)
def test_the_lengths_of_ways_are_those_of_the_plain_twin(is_open: np.ndarray, data: st.DataObject) -> None:
    start = data.draw(st.tuples(st.integers(0, is_open.shape[0] - 1), st.integers(0, is_open.shape[1] - 1)))
    assert shortest_ways(is_open, start)[0] == pytest.approx(plain_lengths(is_open, start))


def hall(*, unknown: slice) -> OccupancyGrid:
    """A hall of 6 m by 3 m with a wall across it that has a gap of 1 m in the north; columns of it are unknown."""
    states = np.full((60, 120), Cell.OCCUPIED, dtype=np.int8)
    states[1:-1, 1:-1] = Cell.FREE
    states[:40, 58:60] = Cell.OCCUPIED
    states[:, unknown] = Cell.UNKNOWN
    return OccupancyGrid(states=states, resolution=0.05, x=-1.0, y=2.0)


def test_the_way_to_a_view_leads_around_what_is_in_the_way_and_keeps_clear_of_it() -> None:
    grid = hall(unknown=slice(100, 120))
    ways = Ways(grid, (0.0, 2.8), 0.3)
    (frontier,) = frontiers_of(grid)
    assert frontier.middle[0] == pytest.approx(-1.0 + 5.0, abs=0.1)
    assert frontier.length == pytest.approx(2.9, abs=0.2)
    view = ways.best_view([replace(frontier, reach=1.0)])
    assert view is not None
    assert view.frontiers == (replace(frontier, reach=1.0),)
    assert math.dist(view.stand, frontier.middle) <= 1.0
    assert view.way[0] == (0.0, 2.8)
    assert view.distance == pytest.approx(path_length(view.way))
    assert view.distance > 3.0
    free = grid.mask(Cell.FREE)
    cells = [(int((y - 2.0) / 0.05), int((x + 1.0) / 0.05)) for x, y in view.way]
    for start, end in pairwise(cells[1:]):
        assert is_clear_line(free, start, end)


def test_a_robot_looks_from_where_it_sees_more_for_the_way() -> None:
    grid = hall(unknown=slice(0, 0))
    ways = Ways(grid, (-0.5, 3.5), 0.3)
    beside, ahead, behind = (Frontier(middle=middle, length=1.0, reach=1.0) for middle in ((-0.5, 2.1), (1.5, 2.5), (1.5, 4.0)))
    nearest = ways.best_view([beside, ahead])
    assert nearest is not None
    assert nearest.frontiers == (beside,)
    best = ways.best_view([replace(frontier, length=3.0) if frontier is not beside else frontier for frontier in (beside, ahead, behind)])
    assert best is not None
    assert [frontier.middle for frontier in best.frontiers] == [ahead.middle, behind.middle], "both from one point between them"


@given(
    unknown=arrays.arrays(bool, (12, 20), elements=st.sampled_from([True, False, False])),
    walls=arrays.arrays(bool, (12, 20), elements=st.sampled_from([True, False, False, False])),
    reach=st.sampled_from([1.0, 2.0, 4.0]),
)
def test_views_at_the_ends_of_short_ways_are_those_of_all_ways_and_longer_ones_are_not_worth_more(
    unknown: np.ndarray, walls: np.ndarray, reach: float
) -> None:
    states = np.where(walls, Cell.OCCUPIED, np.where(unknown, Cell.UNKNOWN, Cell.FREE)).repeat(10, axis=0).repeat(10, axis=1)
    grid, start = OccupancyGrid(states=states.astype(np.int8), resolution=0.05), (5.1, 3.1)
    frontiers = [replace(frontier, reach=1.5) for frontier in frontiers_of(grid)]
    view, best = Ways(grid, start, 0.1, reach=reach).best_view(frontiers), Ways(grid, start, 0.1).best_view(frontiers)
    if view is not None:
        assert best is not None
        assert best.value == view.value or reach < best.distance + 0.2 <= longest_worthwhile(frontiers, start, view.value) + 0.3


def test_robots_are_given_a_wide_berth_and_what_they_cut_off_is_not_driven_to() -> None:
    grid = hall(unknown=slice(100, 120))
    ways = Ways(grid, (0.0, 2.8), 0.3, robots=[(1.95, 4.5)], berth=0.7)
    assert ways.best_view([replace(frontier, reach=1.0) for frontier in frontiers_of(grid)]) is None


def test_there_is_no_frontier_where_all_is_known_or_nothing_is() -> None:
    assert frontiers_of(hall(unknown=slice(0, 0))) == []
    blank = OccupancyGrid(states=np.full((20, 20), Cell.UNKNOWN, dtype=np.int8), resolution=0.05)
    assert frontiers_of(blank) == []


@given(
    mask=arrays.arrays(bool, (9, 11), elements=st.sampled_from([True, True, True, False])), row=st.integers(0, 8), column=st.integers(0, 10)
)
def test_lines_from_many_cells_are_those_from_each(mask: np.ndarray, row: int, column: int) -> None:
    rows, columns = (indexes.ravel() for indexes in np.indices(mask.shape))
    is_clear = clear_lines(mask, rows, columns, (row, column)).reshape(mask.shape)
    assert is_clear[row, column] == mask[row, column]
    if mask.all():
        assert is_clear.all()
    for index in np.argwhere(is_clear):
        assert mask[tuple(index)], "a line begins in the cell"


def test_ways_lead_closer_to_the_ends_of_walls_in_a_doorway_and_not_through_a_shut_door() -> None:
    states = np.full((40, 40), Cell.FREE, dtype=np.int8)
    states[:, 20] = Cell.OCCUPIED
    states[13:27, 20] = Cell.FREE  # a doorway of 0.7 m
    grid, door = OccupancyGrid(states=states, resolution=0.05), Box(1.025, 1.0, 1.0, 0.7)
    assert not Ways(grid, (0.5, 1.0), 0.4).is_reachable((1.5, 1.0))
    assert Ways(grid, (0.5, 1.0), 0.4, doorways=[door], radius=0.3).is_reachable((1.5, 1.0))
    assert not Ways(grid, (0.5, 1.0), 0.4, doorways=[door], radius=0.3, shut_doors=[door]).is_reachable((1.5, 1.0))

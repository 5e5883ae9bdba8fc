"""Which place each cell sees, compared with a look along each line."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.space.free_space import SLACK, FreeSpace
from somrs.traffic.coverage import OCCUPIED, SAMPLES, UNSEEN, Coverage
from tests.unit.traffic.test_layout import ONTOLOGY, box, room

CLEARANCE, REACH = 0.28, 1.3


def sees(space: FreeSpace, point: tuple[float, float], cell: tuple[float, float]) -> bool:
    """Whether a robot can drive from the point to the middle of the cell, with a look at each sample of the line."""
    if math.dist(point, cell) > REACH:
        return False
    samples = [(point[0] + (cell[0] - point[0]) * i / SAMPLES, point[1] + (cell[1] - point[1]) * i / SAMPLES) for i in range(SAMPLES + 1)]
    return bool(min(space.clearances(samples)) >= CLEARANCE - SLACK)


coordinate = st.floats(0.2, 3.8)
tables = st.lists(st.tuples(coordinate, coordinate, st.floats(0.1, 2.0), st.floats(0.1, 2.0)), max_size=4)


@given(tables, st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=4))
def test_each_cell_sees_the_first_place_to_which_a_robot_drives_from_there(
    tables: list[tuple[float, float, float, float]], points: list[tuple[float, float]]
) -> None:
    space = FreeSpace(room(4, 4, *(box(f"Table{number}", "Table", *table) for number, table in enumerate(tables))), ONTOLOGY)
    coverage = Coverage(space, space.field >= CLEARANCE, CLEARANCE, REACH)
    points = [point for point in points if space.free(point, CLEARANCE)]
    for number, point in enumerate(points):
        coverage.note(point, number)
    for row, column in np.argwhere(coverage.free)[::7].tolist():
        cell = space.grid.centre((row, column))
        distances = [abs(math.dist(point, cell) - REACH) for point in points]
        if min(distances, default=1.0) > 1e-6:  # not on the verge of what is near
            expected = next((number for number, point in enumerate(points) if sees(space, point, cell)), UNSEEN)
            assert coverage.seen[row, column] == expected
    assert (coverage.seen[~coverage.free] == OCCUPIED).all()
    clearances = [space.field[row, column] for row, column in coverage.unseen().tolist()]
    assert clearances == sorted(clearances, reverse=True)


@given(tables, st.lists(st.tuples(coordinate, coordinate), min_size=2, max_size=5))
def test_there_is_a_crossing_wherever_a_robot_drives_between_neighbouring_cells(
    tables: list[tuple[float, float, float, float]], points: list[tuple[float, float]]
) -> None:
    space = FreeSpace(room(4, 4, *(box(f"Table{number}", "Table", *table) for number, table in enumerate(tables))), ONTOLOGY)
    coverage = Coverage(space, space.field >= CLEARANCE - SLACK, CLEARANCE, REACH)
    for number, point in enumerate(points):
        if space.free(point, CLEARANCE):
            coverage.note(point, number)
    expected = set()
    for row, column in np.argwhere(coverage.seen >= 0).tolist():
        for near_row, near_column in ((row, column + 1), (row + 1, column), (row + 1, column + 1), (row + 1, column - 1)):
            numbers = {int(coverage.seen[row, column]), int(coverage.seen[near_row, near_column])}
            line = [space.grid.centre((row, column)), space.grid.centre((near_row, near_column))]
            if len(numbers) == 2 and min(numbers) >= 0 and coverage.are_clear(np.array(line[:1]), np.array(line[1:]))[0]:
                expected.add(tuple(sorted(numbers)))
    crossings = coverage.crossings()
    assert {*zip(crossings.low.tolist(), crossings.high.tolist(), strict=True)} == expected


def test_crossings_lead_from_what_sees_one_place_to_what_sees_another() -> None:
    space = FreeSpace(room(4, 2), ONTOLOGY)
    coverage = Coverage(space, space.field >= CLEARANCE, CLEARANCE, REACH)
    for number, x in enumerate((1.0, 2.0, 3.0)):
        coverage.note((x, 1.0), number)
    crossings = coverage.crossings()
    assert [*zip(crossings.low.tolist(), crossings.high.tolist(), strict=True)] == [(0, 1), (1, 2)]
    for starts, ends, low in zip(crossings.starts, crossings.ends, crossings.low.tolist(), strict=True):
        numbers = {int(coverage.seen[space.grid.clipped((float(x), float(y)))]) for x, y in (starts, ends)}
        assert numbers == {low, low + 1}
        assert math.dist(starts, ends) == pytest.approx(space.grid.size, rel=0.5)

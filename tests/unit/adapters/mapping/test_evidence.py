"""What scans show of cells, against a plain twin that goes ray by ray."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from somrs.adapters.mapping.evidence import Evidence, passed_cells
from somrs.sites.occupancy.grid import Cell

RAYS = st.lists(st.tuples(st.floats(-math.pi, math.pi), st.one_of(st.none(), st.floats(0.1, 3.0))), min_size=1, max_size=12)


def plainly_passed(x: float, y: float, angle: float, length: float, resolution: float) -> set[tuple[int, int]]:
    """The cells that a ray passes, one step of half a cell after the other."""
    cells: set[tuple[int, int]] = set()
    step = 0
    while step * resolution / 2 < length - resolution / 2:
        distance = step * resolution / 2
        cells.add((math.floor((y + distance * math.sin(angle)) / resolution), math.floor((x + distance * math.cos(angle)) / resolution)))
        step += 1
    return cells


@given(x=st.floats(-2, 2), y=st.floats(-2, 2), rays=RAYS)
def test_the_cells_that_rays_pass_are_those_of_the_plain_twin(x: float, y: float, rays: list[tuple[float, float | None]]) -> None:
    angles, lengths = np.array([angle for angle, _ in rays]), np.array([2.5 if length is None else length for _, length in rays])
    twin = {cell for angle, length in zip(angles, lengths, strict=True) for cell in plainly_passed(x, y, float(angle), float(length), 0.1)}
    assert {(int(row), int(column)) for row, column in passed_cells(x, y, angles, lengths, 0.1)} == twin


@given(x=st.floats(-2, 2), y=st.floats(-2, 2), rays=RAYS)
def test_where_a_ray_ends_is_occupied_and_on_its_way_is_free_unless_another_one_ends_there(
    x: float, y: float, rays: list[tuple[float, float | None]]
) -> None:
    evidence = Evidence(0.1)
    angles = np.array([angle for angle, _ in rays])
    evidence.add_scan(x, y, angles, [length for _, length in rays], 2.5)
    grid = evidence.grid()
    ends = [(x + (r + 0.025) * math.cos(a), y + (r + 0.025) * math.sin(a)) for a, r in rays if r is not None]
    middles = np.array([[(math.floor(end[0] / 0.1) + 0.5) * 0.1, (math.floor(end[1] / 0.1) + 0.5) * 0.1] for end in ends])
    if ends:
        assert set(grid.state_at(grid.to_local(middles)).tolist()) == {Cell.OCCUPIED}
    for angle, length in rays:
        middles = np.array([[(c + 0.5) * 0.1, (r + 0.5) * 0.1] for r, c in plainly_passed(x, y, angle, length or 2.5, 0.1)]).reshape(-1, 2)
        assert set(grid.state_at(grid.to_local(middles)).tolist()) <= {Cell.FREE, Cell.OCCUPIED}


def test_what_has_gone_is_free_after_a_few_scans() -> None:
    evidence = Evidence()
    ahead = np.array([0.0])

    def state() -> int:
        grid = evidence.grid()
        return int(grid.state_at(grid.to_local([(2.01, 0.01)]))[0])

    for _ in range(10):
        evidence.add_scan(0.01, 0.01, ahead, [2.0], 5.0)
    assert state() == Cell.OCCUPIED
    evidence.add_scan(0.01, 0.01, ahead, [None], 5.0)
    assert state() == Cell.OCCUPIED
    for _ in range(12):
        evidence.add_scan(0.01, 0.01, ahead, [None], 5.0)
    assert state() == Cell.FREE


def test_nothing_is_known_without_a_scan() -> None:
    assert Evidence().grid().shape == (0, 0)

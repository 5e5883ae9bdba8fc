"""Clearances of cells against a plain twin, which looks at every cell for every floor, and at the whole grid at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from somrs.space.clearance import FAR, TILE, Field, Grid, clearances
from somrs.space.distances import distances_from
from somrs.space.solids import Role, Solid
from tests.support.examples import examples

CELLS = TILE + 90
"""Cells of a side, so that there are four tiles."""
GRID = Grid(0.0, 0.0, CELLS, CELLS)
COORDINATES = st.integers(0, round(CELLS * GRID.size * 10)).map(lambda tenths: tenths / 10 + 0.0137)
"""In metres; so that no edge of an upright solid goes exactly through the centres of cells, which may then count as inside or outside."""
SIZES = st.integers(1, 120).map(lambda tenths: tenths / 10)
FORMS = ("Box", "Polygon", "Cylinder")


@st.composite
def solids(draw: st.DrawFn) -> Solid:
    form, width, depth = draw(st.sampled_from(FORMS)), draw(SIZES), draw(SIZES)
    outline = ((0.0, 0.0), (width, 0.0), (width, depth), (width / 3, depth / 4), (0.0, depth)) if form == "Polygon" else ()
    x, y, yaw = draw(COORDINATES), draw(COORDINATES), draw(st.sampled_from((0.0, 0.3, 1.5707963)))
    return Solid(
        name="A", type="T", role=Role.FLOOR, x=x, y=y, z=0.0, yaw=yaw, form=form,
        width=width, depth=depth, radius=width / 2, outline=outline,
    )  # fmt: skip


def plain_clearances(obstacles: Sequence[Solid], floors: Sequence[Solid], passages: Sequence[Solid]) -> Field:
    rows, columns = np.indices((GRID.rows, GRID.columns)).reshape(2, -1)
    points = GRID.centres(np.stack([rows, columns], axis=1))
    ground = np.zeros(len(points), dtype=bool)
    for solid, margin in [(floor, GRID.size / 2) for floor in floors] + [(passage, 2 * GRID.size) for passage in passages]:
        ground |= distances_from(solid, points) <= margin
    on_grid = ground.reshape(GRID.rows, GRID.columns)
    inside, outside = ndimage.distance_transform_edt(on_grid) - 0.5, ndimage.distance_transform_edt(~on_grid) - 0.5
    field: Any = np.where(on_grid, inside, -outside) * GRID.size
    for solid in obstacles:
        field = np.minimum(field, distances_from(solid, points).reshape(field.shape))
    field[[0, -1], :] = field[:, [0, -1]] = -FAR
    clipped: Field = np.clip(field, -FAR, FAR).astype(np.float32)
    return clipped


@given(st.lists(solids(), max_size=3), st.lists(solids(), min_size=1, max_size=4), st.lists(solids(), max_size=2))
@examples(25)
def test_tile_by_tile_it_is_the_same(obstacles: list[Solid], floors: list[Solid], passages: list[Solid]) -> None:
    expected = plain_clearances(obstacles, floors, passages)
    differing = np.abs(clearances(GRID, obstacles, floors, passages) - expected) > 1e-4
    assert not differing.any(), np.argwhere(differing)[:5]


def test_ground_that_is_shared_stays_as_it_is() -> None:
    floor = Solid(name="F", type="Floor", role=Role.FLOOR, x=8.0, y=8.0, z=0.0, yaw=0.0, form="Box", width=10.0, depth=10.0)
    table = Solid(name="T", type="Table", role=Role.SUPPORT, x=8.0, y=8.0, z=0.0, yaw=0.0, form="Box", width=1.0, depth=1.0)
    bare = clearances(GRID, [], [floor], [])
    furnished = clearances(GRID, [table], [floor], [])
    middle = GRID.clipped((8.0, 8.0))
    assert furnished[middle] < 0 < bare[middle]
    assert np.array_equal(clearances(GRID, [], [floor], []), bare)


COARSE = Grid(-1.0, 2.0, 5, 7, 0.5)
VALUES = np.random.default_rng(1).uniform(-FAR, FAR, (COARSE.rows, COARSE.columns)).astype(np.float32)


@given(st.floats(-2.0, 4.0) | st.integers(-8, 16).map(lambda n: n / 4), st.floats(1.0, 6.0) | st.integers(4, 24).map(lambda n: n / 4))
def test_the_value_at_a_point_is_that_of_a_sample(x: float, y: float) -> None:
    assert COARSE.value(VALUES, (x, y)) == pytest.approx(float(COARSE.sample(VALUES, [(x, y)])[0]), abs=1e-6)

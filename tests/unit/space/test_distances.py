"""The distance to one point is the reference for the distances to many."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.space.distances import STEP, distances_from, outline_points
from somrs.space.solids import Role, Solid

COORDINATES = st.floats(-5, 5, allow_nan=False)
FORMS = {
    "Box": {"width": 2.0, "depth": 0.5},
    "Cylinder": {"radius": 0.7},
    "Polygon": {"outline": ((0.0, 0.0), (3.0, 0.0), (3.0, 2.0), (1.0, 0.5), (0.0, 2.0))},
}


@pytest.mark.parametrize("form", FORMS)
@given(pose=st.tuples(COORDINATES, COORDINATES, COORDINATES), points=st.lists(st.tuples(COORDINATES, COORDINATES), min_size=1, max_size=20))
def test_one_by_one_it_is_the_same(form: str, pose: tuple[float, float, float], points: list[tuple[float, float]]) -> None:
    x, y, yaw = pose
    solid = Solid(name="A", type="T", role=Role.STATIC, x=x, y=y, z=0.0, yaw=yaw, form=form, **FORMS[form])  # type: ignore[arg-type]
    many_distances = distances_from(solid, np.array(points))
    assert many_distances == pytest.approx([solid.distance(*point) for point in points], abs=1e-9)


@pytest.mark.parametrize("form", FORMS)
@given(pose=st.tuples(COORDINATES, COORDINATES, COORDINATES))
def test_outlines_are_sampled_all_around(form: str, pose: tuple[float, float, float]) -> None:
    x, y, yaw = pose
    solid = Solid(name="A", type="T", role=Role.STATIC, x=x, y=y, z=0.0, yaw=yaw, form=form, **FORMS[form])  # type: ignore[arg-type]
    points = outline_points(solid)
    is_middle = distances_from(solid, points) < -0.01
    assert is_middle.tolist() == [*[False] * (len(points) - 1), form != "Polygon"]
    around = points[~is_middle]
    assert np.hypot(*(around - np.roll(around, -1, axis=0)).T).max() <= STEP + 1e-9
    assert np.abs(distances_from(solid, around)).max() < 0.01

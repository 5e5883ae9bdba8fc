"""The distance to one point is the reference for the distances to many."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.devices.simulator.world.distances import distances_from
from somrs.devices.simulator.world.solids import Role, Solid

NEAR = st.floats(-5, 5, allow_nan=False)
FORMS = {
    "Box": {"width": 2.0, "depth": 0.5},
    "Cylinder": {"radius": 0.7},
    "Polygon": {"outline": ((0.0, 0.0), (3.0, 0.0), (3.0, 2.0), (1.0, 0.5), (0.0, 2.0))},
}


@pytest.mark.parametrize("form", FORMS)
@given(at=st.tuples(NEAR, NEAR, NEAR), points=st.lists(st.tuples(NEAR, NEAR), min_size=1, max_size=20))
def test_one_by_one_it_is_the_same(form: str, at: tuple[float, float, float], points: list[tuple[float, float]]) -> None:
    x, y, yaw = at
    solid = Solid(name="A", type="T", role=Role.STATIC, x=x, y=y, z=0.0, yaw=yaw, form=form, **FORMS[form])  # type: ignore[arg-type]
    together = distances_from(solid, np.array(points))
    assert together == pytest.approx([solid.distance(*point) for point in points], abs=1e-9)

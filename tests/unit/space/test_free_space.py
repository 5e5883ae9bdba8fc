"""The free space of a floor, and points along the edges of what stands there."""

from __future__ import annotations

import math

import pytest

from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Value
from somrs.space.edges import edge_targets
from somrs.space.free_space import FreeSpace
from somrs.space.solids import solid_of

ONTOLOGY = upper()
RADIUS = 0.25


def box(
    name: str, type: str, x: float, y: float, width: float, depth: float, height: float = 1.0, z: float = 0.0, **attributes: Value
) -> Object:
    shape: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": width, "Shape.Depth": depth, "Shape.Height": height}
    return Object(name=name, type=type, values={"PositionX": x, "PositionY": y, "PositionZ": z, **shape, **attributes})


def floor(width: float, depth: float) -> Object:
    return box("Floor1", "Floor", width / 2, depth / 2, width, depth, 0.1, -0.1)


def free_space(*objects: Object) -> FreeSpace:
    return FreeSpace(Map(objects), ONTOLOGY)


def test_the_clearance_is_the_distance_from_walls_and_from_the_edge_of_the_floor() -> None:
    space = free_space(floor(6, 4), box("Wall1", "Wall", 3, 2, 0.2, 4, 2.5))
    assert space.clearance((2.3, 2)) == pytest.approx(0.6, abs=0.03)
    assert space.clearance((0.4, 2)) == pytest.approx(0.4, abs=0.06)
    assert space.clearance((3, 2)) < 0
    assert space.clearance((-1, 2)) < 0, "there is no floor"
    assert not space.is_clear((2, 2), (4, 2), RADIUS)
    assert space.is_clear((2, 1), (2, 3), RADIUS)


def test_a_floor_that_ends_at_the_walls_does_not_close_the_door() -> None:
    halves = [box(f"Floor{i}", "Floor", x, 2, 4, 4, 0.1, -0.1) for i, x in enumerate((2, 6.1))]
    door = box("Door1", "Door", 4.05, 2, 0.1, 0.9, 2, Open=True)
    assert free_space(*halves).clearance((4.05, 2)) < RADIUS
    assert free_space(*halves, door).clearance((4.05, 2)) > RADIUS


def test_what_hangs_above_the_robot_is_no_obstacle_and_nor_is_what_is_carried() -> None:
    def clearance(thing: Object) -> float:
        return free_space(floor(6, 6), thing).clearance((3, 3))

    assert clearance(box("Cupboard1", "Cupboard", 3, 3, 1, 1, 0.5, 1.9)) == 1.0
    assert clearance(box("Cupboard1", "Cupboard", 3, 3, 1, 1, 0.5, 1.2)) < 0
    assert clearance(Object(name="Jar1", type="Jar", values={"PositionX": 3.0, "PositionY": 3.0, "PositionZ": 0.0})) == 1.0


def test_outside_there_is_ground_only_where_there_are_no_floors() -> None:
    bin = box("Bin1", "Bin", 1, 1, 0.3, 0.3)
    assert not free_space(bin, floor(2, 2)).free((3, 3), RADIUS)
    assert free_space(bin).free((3, 3), RADIUS)


@pytest.mark.parametrize("form", ["Box", "Cylinder", "Polygon"])
def test_points_along_the_edge_of_any_form_are_on_it_and_look_outwards(form: str) -> None:
    values: dict[str, Value] = {"PositionX": 1.0, "PositionY": 2.0, "RotationZ": 0.7, "Shape.Form": form, "Shape.Height": 0.5}
    values |= {"Shape.Width": 1.0, "Shape.Depth": 0.1, "Shape.Radius": 0.4, "Shape.Outline": "0,0 0,1 1,1 1,0"}
    solid = solid_of(Object(name="Shelf1", type="Shelf", values=values), ONTOLOGY)
    assert solid is not None
    targets = list(edge_targets(solid, 0.1))
    assert len(targets) >= 4
    for (x, y), (nx, ny) in targets:
        assert solid.distance(x, y) < -0.03
        assert math.hypot(nx, ny) == pytest.approx(1)
        assert solid.distance(x + 0.01 * nx, y + 0.01 * ny) > solid.distance(x, y) or form == "Box"
        assert solid.distance(x + nx, y + ny) > 0

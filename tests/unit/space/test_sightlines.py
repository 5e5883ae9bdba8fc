"""Lines of sight, compared with the rays of MuJoCo through the same world."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.devices.simulator.world.kinematics import KinematicScene
from somrs.devices.simulator.world.physics import PhysicsScene
from somrs.ontology.map import Map
from somrs.space.sightlines import Place, Prisms, hull
from somrs.space.solids import Solid, solid_of
from tests.support.simulator_room import ONTOLOGY, box, robot, room, thing

FURNITURE = [
    box("Crate1", "Platform", (3.2, 3.1, 0), (0.9, 0.4, 1.1), RotationZ=0.7),
    box("Cupboard002", "Cupboard", (5.2, 3.3, 0), (0.5, 1.2, 1.5), RotationZ=2.0, Open=True),
    box("Cupboard003", "Cupboard", (2.2, 4.9, 0), (0.5, 0.6, 1.5), RotationZ=-1.0),
    box("Door1", "Door", (4.0, 2.0, 0), (0.1, 1.4, 2.1), RotationZ=0.4, Open=False),
    thing("Bottle1", "Bottle", 3.2, 3.1, 1.1),
    robot("Watcher", (6.0, 3.0, 0.3), type="PatrolRobot"),
]
MAP = Map(room(extra_objects=FURNITURE).objects.values())
PHYSICS, KINEMATIC = PhysicsScene(MAP, ONTOLOGY), KinematicScene(MAP, ONTOLOGY)
PLACES = st.tuples(st.floats(0.05, 7.95), st.floats(0.05, 5.95), st.floats(0.05, 2.4))
GRAZING = 0.004
"""Distance of a line from a surface below which it may pass or not, m: things settle by less in the physics."""


@given(PLACES, PLACES, st.sets(st.sampled_from(sorted(MAP.objects)), max_size=3))
def test_both_worlds_hide_the_same(start: Place, end: Place, ignored: set[str]) -> None:
    if math.dist(start, end) < 0.1 or _near_surface(start) or _near_surface(end):
        return
    aside = [(dx, dy, dz) for dx in (-GRAZING, GRAZING) for dy in (-GRAZING, GRAZING) for dz in (-GRAZING, GRAZING)]
    seen = {PHYSICS.is_unobstructed(_moved(start, step), _moved(end, step), ignored) for step in [(0.0, 0.0, 0.0), *aside]}
    if len(seen) == 1:
        assert KINEMATIC.is_unobstructed(start, end, ignored) is seen.pop()


def _moved(place: Place, step: Place) -> Place:
    return place[0] + step[0], place[1] + step[1], place[2] + step[2]


def _near_surface(place: Place) -> bool:
    """Whether a place is in a solid: the physics does not see the solid in which a line is whole."""
    x, y, z = place
    return any(solid.z - 0.01 < z < solid.top + 0.01 and solid.distance(x, y) < 0.01 for solid in KINEMATIC.world.solids.values())


def _solid(form: str = "Box", radius: float = 0.0, yaw: float = 0.0) -> Solid:
    solid = solid_of(box("It", "Wall", (1.0, 2.0, 0.5), (2.0, 1.0, 1.0)), ONTOLOGY)
    assert solid is not None
    return replace(solid, form=form, radius=radius, yaw=yaw)


@pytest.mark.parametrize(
    ("solid", "start", "end", "hidden"),
    [
        (_solid(), (-1.0, 2.0, 1.0), (3.0, 2.0, 1.0), True),
        (_solid(), (-1.0, 2.0, 1.0), (-0.1, 2.0, 1.0), False),
        (_solid(), (-1.0, 2.0, 1.6), (3.0, 2.0, 1.6), False),
        (_solid(), (1.0, 2.0, 3.0), (1.0, 2.0, 1.0), True),
        (_solid(), (1.0, 2.6, 3.0), (1.0, 2.6, 0.0), False),
        (_solid(yaw=math.pi / 2), (1.0, 2.6, 3.0), (1.0, 2.6, 0.0), True),
        (_solid(form="Cylinder", radius=0.5), (1.0, 2.4, 3.0), (1.0, 2.4, 0.0), True),
        (_solid(form="Cylinder", radius=0.5), (0.0, 2.49, 1.0), (2.0, 2.49, 1.0), True),
        (_solid(form="Cylinder", radius=0.5), (0.0, 2.51, 1.0), (2.0, 2.51, 1.0), False),
    ],
)
def test_a_solid_hides_what_is_behind_it(solid: Solid, start: Place, end: Place, hidden: bool) -> None:
    assert Prisms(["It"], [solid]).hide(start, end, set()) is hidden
    assert Prisms(["It"], [solid]).hide(start, end, {"It"}) is False


def test_the_hull_of_a_polygon_is_its_box() -> None:
    polygon = _solid(form="Polygon", yaw=math.pi / 2)
    box_around = hull(replace(polygon, outline=((0.0, 0.0), (2.0, 0.0), (2.0, 1.0))))
    assert (box_around.x, box_around.y) == pytest.approx((0.5, 3.0))
    assert (box_around.form, box_around.width, box_around.depth) == ("Box", 2.0, 1.0)

"""Lifts: robots drive in and out through the doors of the cabin and nowhere else, on the storeys where it stops and on no other."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.types import Value
from somrs.space.free_space import FreeSpace
from somrs.space.shafts import Shaft, shafts_of

ONTOLOGY = upper()
RADIUS = 0.25


def box(name: str, type: str, x: float, y: float, z: float, size: tuple[float, float, float], yaw: float = 0.0, **values: Value) -> Object:
    shape: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": size[0], "Shape.Depth": size[1], "Shape.Height": size[2]}
    pose: dict[str, Value] = {"PositionX": x, "PositionY": y, "PositionZ": z, "RotationZ": yaw}
    return Object(name=name, type=type, values={**pose, **shape, **values})


def building(yaw: float = 0.0, side: int = 0, width: float = 2.0, depth: float = 2.4) -> Map:
    """Three floors around a lift at the origin, which stops at the first and the third; its door is on one side of the cabin."""
    floors = [box(f"Floor{number}", "Floor", 0, 0, 4.0 * number - 0.1, (12, 12, 0.1)) for number in range(3)]
    storeys = [Object(name=f"Storey{number}", type="Storey", values={"Elevation": 4.0 * number}) for number in range(3)]
    angle, far = yaw + side * math.pi / 2, (depth if side % 2 else width) / 2 + 0.15
    doors = [
        box(f"Door{n}", "LiftDoor", far * math.cos(angle), far * math.sin(angle), 4.0 * n, (1.2, 0.1, 2.1), angle + math.pi / 2)
        for n in (0, 2)
    ]
    facts = [Fact("stopsAt", ("Lift1", f"Storey{n}")) for n in (0, 2)] + [Fact("leadsInto", (f"Door{n}", "Lift1")) for n in (0, 2)]
    return Map([*floors, *storeys, *doors, box("Lift1", "Lift", 0, 0, 0, (width, depth, 2.3), yaw)], facts)


def shaft(map: Map) -> Shaft:
    (known,) = shafts_of(map, ONTOLOGY)
    return known


@given(yaw=st.floats(-math.pi, math.pi), side=st.integers(0, 3), level=st.sampled_from((0.0, 8.0)))
def test_the_door_is_the_only_way_into_the_cabin(yaw: float, side: int, level: float) -> None:
    free_space = FreeSpace(building(yaw, side), ONTOLOGY, level=level)
    ways = []
    for number in range(4):
        angle = yaw + number * math.pi / 2
        outside = 2.5 * math.cos(angle), 2.5 * math.sin(angle)
        assert free_space.free(outside, RADIUS)
        ways.append(free_space.is_clear((0, 0), outside, RADIUS))
    assert ways == [number == side for number in range(4)]


@given(yaw=st.floats(-math.pi, math.pi))
def test_where_the_lift_does_not_stop_its_shaft_is_solid(yaw: float) -> None:
    free_space = FreeSpace(building(yaw), ONTOLOGY, level=4.0)
    assert free_space.clearance((0, 0)) < 0
    assert free_space.free((3, 3), RADIUS)


def test_the_place_of_the_cabin_does_not_matter() -> None:
    map = building()
    higher = map.objects["Lift1"].values | {"PositionZ": 8.0}
    moved = Map([*(o for o in map.objects.values() if o.name != "Lift1"), Object(name="Lift1", type="Lift", values=higher)], map.facts())
    for level in (0.0, 4.0, 8.0):
        fields = [FreeSpace(state, ONTOLOGY, level=level).field for state in (map, moved)]
        assert (fields[0] == fields[1]).all()


def test_a_lift_without_doors_stops_nowhere() -> None:
    map = building()
    doorless = Map([o for o in map.objects.values() if o.type != "LiftDoor"], [fact for fact in map.facts() if fact.relation == "stopsAt"])
    assert shaft(doorless).landings == ()
    assert FreeSpace(doorless, ONTOLOGY).clearance((0, 0)) < 0
    assert [landing.storey for landing in shaft(map).landings] == ["Storey0", "Storey2"]


def test_the_room_to_the_doors_of_a_storey() -> None:
    known = shaft(building())
    assert math.isclose(known.room_to_doors((0.5, 0), 0.0), 1.15 - 0.05 - 0.5)
    assert known.room_to_doors((0.5, 0), 4.0) == math.inf

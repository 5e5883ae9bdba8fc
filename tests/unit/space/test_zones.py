"""Zones on a map: what they are, and how fast a robot may be near a slow one."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Value
from somrs.space.findings import find_mistakes
from somrs.space.solids import solid_of
from somrs.space.zones import Zones, zones_of

ONTOLOGY = upper()
BRAKING = 0.72


def zone(name: str = "Zone1", type: str = "NoGoZone", /, **values: Value) -> Object:
    box: dict[str, Value] = {"PositionX": 4.0, "PositionY": 3.0, "Shape.Form": "Box", "Shape.Width": 2.0, "Shape.Depth": 1.0}
    return Object(name=name, type=type, values={**box, **values})


def flat(name: str = "Zone1") -> Object:
    """A zone without extent."""
    none: dict[str, Value] = {"Shape.Width": 0.0, "Shape.Depth": 0.0}
    return zone(name, **none)


def zones(*objects: Object) -> Zones:
    return zones_of(Map([*objects]), ONTOLOGY)


def test_a_no_go_zone_is_touched_by_a_robot_at_its_edge_and_only_on_its_floor() -> None:
    drawn = zones(zone())
    assert drawn.forbidden_zone_at((4, 3), 0.0, 0.2) == "Zone1"
    assert drawn.forbidden_zone_at((5.1, 3), 0.0, 0.2) == "Zone1"
    assert drawn.forbidden_zone_at((5.3, 3), 0.0, 0.2) is None
    assert drawn.forbidden_zone_at((4, 3), 4.0, 0.2) is None


def test_a_polygon_is_a_zone_too() -> None:
    drawn = zones(zone(**{"Shape.Form": "Polygon", "Shape.Outline": "0,0 2,0 0,2"}))
    assert drawn.forbidden_zone_at((4.5, 3.5), 0.0, 0.1) == "Zone1"
    assert drawn.forbidden_zone_at((5.8, 4.8), 0.0, 0.1) is None


def test_zones_stand_in_nobodys_way_and_one_without_extent_is_none() -> None:
    assert solid_of(zone(), ONTOLOGY) is None
    assert zones(flat()) == Zones()
    assert zones(zone(**{"Shape.Form": "Polygon", "Shape.Outline": "0,0 1"})) == Zones()


@given(st.floats(-5, 12), st.floats(-4, 9), st.floats(-math.pi, math.pi), st.floats(0.05, 1.5))
def test_whoever_drives_as_fast_as_is_allowed_is_slow_enough_in_the_zone(x: float, y: float, heading: float, limit: float) -> None:
    drawn = zones(zone("Zone1", "SlowZone", SpeedLimit=limit))
    (area, _) = drawn.slow[0]
    direction, step = (math.cos(heading), math.sin(heading)), 0.02
    speed = drawn.speed_limit((x, y), 0.0, direction, BRAKING)
    speed = min(speed, 2.0)
    for _ in range(300):
        x, y = x + speed * step * direction[0], y + speed * step * direction[1]
        allowed = drawn.speed_limit((x, y), 0.0, direction, BRAKING)
        if area.distance(x, y) <= 0:
            assert allowed == limit
            assert speed <= limit + 0.05, "it has braked before"
        speed = max(min(speed + 0.8 * step, 2.0, allowed), speed - 1.2 * step)


def test_a_robot_that_leaves_a_slow_zone_is_not_slowed_down_any_more() -> None:
    drawn = zones(zone("Zone1", "SlowZone", SpeedLimit=0.3))
    assert drawn.speed_limit((5.2, 3), 0.0, (1.0, 0.0), BRAKING) == math.inf
    assert drawn.speed_limit((5.2, 3), 0.0, (-1.0, 0.0), BRAKING) < 1.0
    assert drawn.speed_limit((5.2, 3), 4.0, (-1.0, 0.0), BRAKING) == math.inf


def test_the_check_of_a_map_names_zones_that_are_none_and_places_that_nobody_reaches() -> None:
    floor: dict[str, Value] = {
        "PositionX": 5.0,
        "PositionY": 5.0,
        "PositionZ": -0.1,
        "Shape.Form": "Box",
        "Shape.Width": 10.0,
        "Shape.Depth": 10.0,
    }
    objects = [
        Object(name="Floor1", type="Floor", values={**floor, "Shape.Height": 0.1}),
        Object(name="Robot1", type="PioneerP3DX", values={"PositionX": 1.0, "PositionY": 1.0}),
        Object(name="Shelf", type="Place", values={"PositionX": 4.0, "PositionY": 3.0}),
        zone(),
        flat("Zone2"),
        zone("Zone3", PositionZ=4.0),
        zone("Zone4", PositionX=1.0, PositionY=1.0),
    ]
    findings = {(finding.subject, finding.rule): finding.message for finding in find_mistakes(Map(objects), ONTOLOGY)}
    assert findings["Shelf", "no-go"] == "no robot goes there: it is in the no-go zone Zone1; move one of them"
    assert "without extent" in findings["Zone2", "shape"]
    assert findings["Zone3", "no-floor"].startswith("there is no floor under it")
    assert findings["Robot1", "no-go"] == "it stands in the no-go zone Zone4, and can only leave it; move one of them"

"""A robot of the simulator maps buildings of Open-RMF's demos, with their doors open and shut, and its maps are compared with them."""

from __future__ import annotations

import pytest

from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.sites.openrmf import import_building
from tests.support.explored_floor import ExploredFloor, storey
from tests.support.paths import SHARED

OFFICE = SHARED / "sites" / "office.building.yaml"
START = (10.433, -5.575)
HOTEL = SHARED / "sites" / "hotel.building.yaml"
_GUEST_ROOMS = [
    (9.4, -9.6),
    (9.7, -14.3),
    (9.2, -19.1),
    (9.3, -23.8),
    (9.3, -28.6),
    (17.6, -9.6),
    (17.6, -14.5),
    (17.7, -28.6),
    (25.2, -28.7),
]
_GUEST_ROOMS += [(4.6, -38.1), (10.9, -38.6), (15.7, -38.5), (20.7, -38.4), (25.5, -38.4), (30.3, -38.4)]
_BATHROOMS = [(7.9, -35.4), (12.7, -35.6), (17.5, -35.7), (22.3, -35.3), (27.1, -35.3), (31.9, -35.3)]
_CORRIDOR = (14.6, -24.0)
HOTEL_ROOMS = {
    "L1": [(11.0, -13.0), (19.7, -8.8), (17.0, -36.0), (6.0, -36.0), (28.0, -28.0)],
    "L2": [*_GUEST_ROOMS, *_BATHROOMS, _CORRIDOR],
    "L3": [*_GUEST_ROOMS, *_BATHROOMS, _CORRIDOR],
}
"""A point in each room of a storey that has a door."""


@pytest.mark.slow
@pytest.mark.skipif(not OFFICE.exists(), reason="the office is not in ../shared/sites")
@pytest.mark.parametrize("doors_open", [True, False])
def test_the_map_of_an_office_is_the_office(doors_open: bool) -> None:
    site = import_building(OFFICE)
    known_map = Map([Object(name="Ground", type="Storey", values={"Elevation": 0.0})])
    office = storey(site.map, site.ontology, 0.0, START, doors_open=doors_open)
    floor = ExploredFloor(true=office, ontology=site.ontology, made=known_map)
    floor.explore()
    comparison = floor.compare()
    assert comparison.walls >= 0.95
    assert comparison.invented <= 0.02
    assert comparison.furniture >= (70, 74)
    assert comparison.things == (1, 1)
    assert floor.mistakes == []
    assert len(floor.views) < 250
    assert len(floor.doors.moves) == (0 if doors_open else 6), "each door is opened and closed once"


@pytest.mark.slow
@pytest.mark.skipif(not HOTEL.exists(), reason="the hotel is not in ../shared/sites")
@pytest.mark.parametrize(("level", "start"), [("L1", (23.542, -27.42)), ("L2", _CORRIDOR), ("L3", _CORRIDOR)])
def test_the_map_of_a_storey_of_a_hotel_has_its_rooms_also_behind_wide_doors(level: str, start: tuple[float, float]) -> None:
    site = import_building(HOTEL)
    elevation = site.map.objects[level].values["Elevation"]
    assert isinstance(elevation, float)
    known_map = Map([Object(name="Ground", type="Storey", values={"Elevation": elevation})])
    hotel = storey(site.map, site.ontology, elevation, start, doors_open=False)
    floor = ExploredFloor(true=hotel, ontology=site.ontology, made=known_map, elevation=elevation)
    floor.explore()
    comparison = floor.compare(HOTEL_ROOMS[level])
    assert comparison.seen_walls >= 0.95
    assert comparison.invented <= 0.02
    assert comparison.rooms == (len(HOTEL_ROOMS[level]),) * 2
    assert comparison.furniture[0] == comparison.furniture[1]
    assert floor.mistakes == []

"""A robot of the simulator maps the office of Open-RMF's demos, with its doors open and shut, and its map is compared with the office."""

from __future__ import annotations

import pytest

from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.sites.openrmf import import_building
from tests.support.explored_floor import ExploredFloor, storey
from tests.support.paths import SHARED

OFFICE = SHARED / "sites" / "office.building.yaml"
START = (10.433, -5.575)


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

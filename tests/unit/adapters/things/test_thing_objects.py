"""Where things come onto the map, by the name or the label of a room."""

from __future__ import annotations

import asyncio

import pytest

from somrs.adapters.things.model import Thing
from somrs.adapters.things.thing_objects import area_problem, whereabouts
from somrs.ontology.files.loading import load_text, upper
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.service_manager.sdk.map_reader import MapReader
from tests.support.virtual_devices import make_ask

SITE = """
map: House
objects:
  House1:
    type: Building
    parts:
      Ground:
        type: Storey
        parts:
          Floor1: {type: Floor, at: [5, 5, -0.1], Shape: {Form: Box, Width: 10, Depth: 10, Height: 0.1}}
          Hall: {type: Room, Label: entrance hall}
          lobby: {type: Place, at: [1, 1, 0], Label: the lobby}
"""


@pytest.mark.parametrize(
    ("area", "place", "complaint"),
    [
        ("Hall", "Hall", ""),
        ("hall", "Hall", ""),
        ("entrance hall", "Hall", ""),
        ("Ground", "Ground", ""),
        ("", "House1", ""),
        ("lobby", "Ground", "Lamp1: lobby is no room and no storey: it becomes a part of Ground"),
        ("the lobby", "Ground", "Lamp1: the lobby is no room and no storey"),
        ("foyer", "House1", "Lamp1: the map has no foyer, by name or label: it becomes a part of House1"),
    ],
)
def test_a_thing_is_a_part_of_its_area(area: str, place: str, complaint: str, caplog: pytest.LogCaptureFixture) -> None:
    loaded = load_text(SITE, "site.yaml", upper(1))
    assert loaded.map is not None
    repository = Repository("http://here/repository", Contents(ontology=loaded.ontology, map=loaded.map))
    map = MapReader(make_ask(repository, lambda: 0.0))
    assert asyncio.run(whereabouts(map, Thing(name="Lamp1", type="Light", area=area))) == f"Lamp1 isPartOf {place}"
    assert bool(caplog.messages) == bool(complaint)
    assert complaint in "".join(caplog.messages)
    misfit = area_problem(Thing(name="Lamp1", type="Light", area=area), loaded.map, loaded.ontology)
    assert bool(misfit) == bool(complaint), "it is said before the system starts, too"
    assert area_problem(Thing(name="Lamp1", type="Light", area=area, values={"PositionX": 1.0}), loaded.map, loaded.ontology) is None

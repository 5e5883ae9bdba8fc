"""How the map follows a survey: objects keep their names, come and go, and the map is valid each time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from somrs.adapters.mapping.floor_map import FloorMap, Shown
from somrs.adapters.mapping.reporting import situation_of, things_on
from somrs.adapters.mapping.survey import Piece, Survey
from somrs.devices.simulator.link.commands import Sighting
from somrs.ontology.conformance import violations
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, ObjectAdded, ObjectRemoved, ValueSet
from somrs.sites.occupancy.building import Building, Door, Room, building_of
from somrs.sites.occupancy.grid import Cell, OccupancyGrid
from somrs.sites.plan import Box
from tests.support.floor_plans import grid_of, rooms_in_rows

SITE = """
map: Site
objects:
  House:
    type: Building
    parts:
      Ground:
        type: Storey
        parts:
          Start: {type: Floor, at: [1, 1, -0.1], Shape: {Form: Box, Width: 1, Depth: 1, Height: 0.1}}
  Wall001: {type: Wall, at: [50, 50, 0], Shape: {Form: Box, Width: 1, Depth: 0.1, Height: 2}}
"""
LEFT = Room(outline=[(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)], middle=(2.0, 1.5), cells=4000)
RIGHT = Room(outline=[(4.0, 0.0), (7.0, 0.0), (7.0, 3.0), (4.0, 3.0)], middle=(5.5, 1.5), cells=3000)
SOUTH, NORTH = Box(3.5, -0.05, 7.0, 0.1), Box(3.5, 3.05, 7.0, 0.1)
DOOR = Door(box=Box(4.0, 1.5, 0.9, 0.1, 1.57), rooms=(0, 1))
TABLE = Piece(
    type="Table", values={"Shape.Form": "Box", "Shape.Width": 1.4, "Shape.Depth": 0.8, "Shape.Height": 0.74}, x=2, y=1, z=0, yaw=0, count=2
)
WHOLE = Building(walls=[SOUTH, NORTH], obstacles=[Box(2.0, 1.0, 1.4, 0.8)], rooms=[LEFT, RIGHT], doors=[DOOR])


def site() -> Map:
    loaded = load_text(SITE)
    assert loaded.map is not None
    return loaded.map


def follow(map: Map, floor_map: FloorMap, building: Building, pieces: Sequence[Piece] = ()) -> tuple[Map, list[Change]]:
    """The map after a survey, which has to be valid."""
    changes = floor_map.follow(building, pieces)
    map = map.changed(changes)
    assert list(violations(map, upper())) == []
    return map, changes


def test_what_a_survey_shows_comes_to_the_map_and_nothing_changes_when_it_shows_the_same_again() -> None:
    map = site()
    floor_map = FloorMap("Ground", 0.0, map.objects)
    map, _ = follow(map, floor_map, WHOLE, [TABLE])
    assert map.objects["Wall002"].values["Shape.Width"] == 7.0  # the name Wall001 was taken
    assert map.whole("Wall002") == "Ground"
    assert map.has_fact("connects", ("Door001", "Room001", "Room002"))
    assert [name for name, object in map.objects.items() if object.type in ("Table", "Obstacle")] == ["Table001"]
    assert follow(map, floor_map, WHOLE, [TABLE])[1] == []
    shifted = replace(WHOLE, walls=[replace(SOUTH, y=-0.06), NORTH])
    assert follow(map, floor_map, shifted, [TABLE])[1] == []


def test_a_wall_that_grows_stays_the_same_object_and_one_that_is_gone_goes() -> None:
    map = site()
    floor_map = FloorMap("Ground", 0.0, map.objects)
    map, _ = follow(map, floor_map, replace(WHOLE, walls=[replace(SOUTH, x=2.0, width=4.0), NORTH]))
    map, _ = follow(map, floor_map, WHOLE)
    assert map.objects["Wall002"].values["Shape.Width"] == 7.0
    map, changes = follow(map, floor_map, replace(WHOLE, walls=[SOUTH]))
    assert changes == [ObjectRemoved("Wall003")]


def test_a_room_that_turns_out_to_be_two_keeps_its_name_for_one_of_them() -> None:
    map = site()
    floor_map = FloorMap("Ground", 0.0, map.objects)
    both = replace(LEFT, outline=[(0.0, 0.0), (7.0, 0.0), (7.0, 3.0), (0.0, 3.0)])
    map, _ = follow(map, floor_map, Building(walls=[], obstacles=[], rooms=[both], doors=[]))
    map, _ = follow(map, floor_map, WHOLE)
    assert {name for name, object in map.objects.items() if object.type == "Room"} == {"Room001", "Room002"}
    assert map.has_fact("connects", ("Door001", "Room001", "Room002"))
    map, _ = follow(map, floor_map, replace(WHOLE, rooms=[RIGHT, LEFT], doors=[replace(DOOR, rooms=(1, 0))]))
    assert [*map.facts("connects")] == [Fact("connects", ("Door001", "Room001", "Room002"))]


def test_what_others_have_put_on_the_map_stays_and_is_not_added_again() -> None:
    map = site()
    floor_map = FloorMap("Ground", 0.0, map.objects)
    floor_map.add_foreign("Wall001", Shown(kind="Wall", box=SOUTH))
    changes = floor_map.follow(replace(WHOLE, walls=[SOUTH, NORTH]), [])
    added = [change.object.name for change in changes if isinstance(change, ObjectAdded)]
    assert added.count("Wall002") == 1
    assert "Wall003" not in added
    assert floor_map.follow(Building(walls=[], obstacles=[], rooms=[], doors=[]), [])
    assert not any(isinstance(change, ObjectRemoved) and change.name == "Wall001" for change in changes)


WALLS = [SOUTH, NORTH, replace(SOUTH, x=1.0, width=2.0), replace(SOUTH, x=6.0, width=2.0)]
OBSTACLES = [Box(1.0, 2.0, 0.5, 0.5), Box(1.3, 2.0, 0.5, 0.5), Box(6.0, 2.0, 1.0, 0.5)]
DOORS = [DOOR, replace(DOOR, rooms=(1, 0)), replace(DOOR, box=replace(DOOR.box, y=2.4))]
BUILDINGS = st.builds(
    Building,
    walls=st.lists(st.sampled_from(WALLS), max_size=3, unique=True),
    obstacles=st.lists(st.sampled_from(OBSTACLES), max_size=2, unique=True),
    rooms=st.just([LEFT, RIGHT]) | st.just([RIGHT, LEFT]),
    doors=st.lists(st.sampled_from(DOORS), max_size=2, unique=True),
)


@settings(deadline=None, max_examples=50)
@given(buildings=st.lists(BUILDINGS, min_size=1, max_size=5))
def test_the_map_is_valid_whatever_surveys_show_and_has_just_that(buildings: list[Building]) -> None:
    map = site()
    floor_map = FloorMap("Ground", 0.0, map.objects)
    for building in buildings:
        map, _ = follow(map, floor_map, building)
        kinds = [object.type for name, object in map.objects.items() if name != "Wall001"]
        counts = [kinds.count(kind) for kind in ("Wall", "Obstacle", "Room", "Door")]
        assert counts == [len(building.walls), len(building.obstacles), len(building.rooms), len(building.doors)]
        assert len([*map.facts("connects")]) == len(building.doors)


CHAIR = Shown(kind="Chair", box=Box(1.5, 1.5, 0.5, 0.5))


def test_a_door_of_others_that_is_shut_and_furniture_that_has_gone_are_news_once() -> None:
    plan = rooms_in_rows([4.0, 3.0], [3.0], 0.1, [(0.9, 0.5)])
    floor_map = FloorMap("Ground", 0.0)
    door = Box(4.0, plan.doors[0].y, 0.9, 0.1, math.pi / 2)
    floor_map.add_foreign("Gate", Shown(kind="Door", box=door, values={"Open": True}))
    floor_map.add_foreign("Seat", CHAIR)
    floor_map.add_foreign("Stool", replace(CHAIR, box=replace(CHAIR.box, x=3.0)))
    shut = grid_of(plan, obstacles=[door, Box(3.0, 1.5, 0.5, 0.5)])
    assert floor_map.observed(shut) == (["Gate.Open = FALSE"], ["Seat"])
    assert floor_map.observed(shut) == ([], [])
    assert floor_map.observed(grid_of(plan, obstacles=[Box(3.0, 1.5, 0.5, 0.5)])) == (["Gate.Open = TRUE"], [])


def test_a_door_that_the_survey_has_brought_stays_when_it_is_shut() -> None:
    plan = rooms_in_rows([4.0, 3.0], [3.0], 0.1, [(0.9, 0.5)])
    map = site()
    floor_map = FloorMap("Ground", 0.0, map.objects)
    map, _ = follow(map, floor_map, building_of(grid_of(plan)))
    shut = grid_of(plan, obstacles=plan.doors)
    assert floor_map.observed(shut) == (["Door001.Open = FALSE"], [])
    map, _ = follow(map, floor_map, building_of(shut))
    assert "Door001" in map.objects


def test_what_an_earlier_survey_has_brought_is_corrected_when_all_has_been_seen_again() -> None:
    plan = rooms_in_rows([4.0, 3.0], [3.0], 0.1, [(0.9, 0.5)])
    map = site()
    first = FloorMap("Ground", 0.0, map.objects)
    map, _ = follow(map, first, building_of(grid_of(plan)))
    short = replace(SOUTH, x=1.0, width=2.0)
    second = FloorMap("Ground", 0.0, map.objects)
    values = map.objects["Wall002"].values
    second.add_foreign("Wall002", Shown(kind="Wall", box=short, values=values), is_earlier=True)
    second.add_foreign("Obstacle009", Shown(kind="Obstacle", box=Box(2.0, 1.5, 0.5, 0.5)), is_earlier=True)
    second.add_foreign("Obstacle010", Shown(kind="Obstacle", box=Box(20.0, 1.5, 0.5, 0.5)), is_earlier=True)
    shown = Building(walls=[SOUTH], obstacles=[], rooms=[], doors=[])
    assert second.follow(shown, []) == []
    assert second.surveyed_names == ["Wall002", "Obstacle009", "Obstacle010"]
    second.adopt_earlier(grid_of(plan))
    changes = second.follow(shown, [])
    assert ObjectRemoved("Obstacle009") in changes
    assert ObjectRemoved("Obstacle010") not in changes  # it was not seen
    assert any(isinstance(change, ValueSet) and change.object == "Wall002" for change in changes)


def test_what_was_not_seen_is_no_news() -> None:
    floor_map = FloorMap("Ground", 0.0)
    floor_map.add_foreign("Gate", Shown(kind="Door", box=Box(4.0, 1.5, 0.9, 0.1, 1.57)))
    floor_map.add_foreign("Seat", CHAIR)
    blank = OccupancyGrid(states=np.full((100, 200), Cell.UNKNOWN, dtype=np.int8), resolution=0.05)
    assert floor_map.observed(blank) == ([], [])


def test_a_thing_is_reported_on_the_furniture_below_it_and_one_in_the_air_is_not_reported() -> None:
    floor_map = FloorMap("Ground", 0.0)
    floor_map.follow(WHOLE, [TABLE])
    jar = Sighting(type="Jar", x=2.3, y=1.1, z=0.741, yaw=0.0)
    things = things_on(floor_map, [jar, Sighting(type="Jar", x=2.3, y=1.1, z=1.5, yaw=0.0), Sighting(type="Jar", x=5, y=1, z=0.0, yaw=0.0)])
    assert [thing.support for thing in things] == ["Table001", "Floor002"]
    assert "?Seen0 isOn Table001" in situation_of(things)


def test_a_piece_of_furniture_is_where_the_mean_of_its_sightings_is() -> None:
    survey = Survey(0.22)
    for x in (1.0, 1.1, 1.2):
        survey.add_furniture([Sighting(type="Chair", furniture=True, values={"Shape.Width": 0.45}, x=x, y=2.0, z=0.0, yaw=3.1 + x / 10)])
    survey.add_furniture([Sighting(type="Table", furniture=True, x=1.1, y=2.0, z=0.0, yaw=0.0)])
    chair, table = survey.pieces
    assert (chair.type, chair.count, table.type) == ("Chair", 3, "Table")
    assert chair.x == pytest.approx(1.1)
    assert chair.yaw == pytest.approx(3.21)
    survey.add_robots([(0.0, 0.0), (5.0, 5.0)])
    survey.add_robots([(0.2, 0.0)])
    assert survey.robots == [(5.0, 5.0), (0.2, 0.0)]

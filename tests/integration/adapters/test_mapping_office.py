"""A robot of the simulator maps the building of Scenario 1, of which it knows nothing, and its map is compared with the building."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path

from somrs.adapters.mapping.exploring import explore
from somrs.adapters.mapping.floor_map import FloorMap
from somrs.adapters.mapping.reporting import things_on
from somrs.adapters.mapping.survey import Survey
from somrs.devices.simulator.link.commands import CommandDone
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.conformance import violations
from somrs.ontology.files.loading import load
from somrs.ontology.map import Map
from somrs.ontology.objects import Object, ObjectAdded
from somrs.sites.occupancy.building import building_of
from somrs.space.findings import find_mistakes
from tests.support.map_comparison import compare, draw
from tests.support.paths import ROOT
from tests.support.simulated_link import SimulatedLink

WORLD = ROOT / "examples" / "unknown_floor" / "world.yaml"
SITE = WORLD.with_name("site.yaml")


def test_the_map_that_a_robot_makes_is_the_building(tmp_path: Path) -> None:
    world, site = load([WORLD]), load([SITE])
    assert world.map is not None
    assert site.map is not None
    simulation = Simulation(world.map, world.ontology, WorldKind.KINEMATIC)
    survey, floor_map, map = Survey(radius=0.22), FloorMap("Ground", 0.0, site.map.objects), site.map
    views: list[CommandDone] = []

    async def noted(view: CommandDone) -> None:
        nonlocal map
        views.append(view)
        if len(views) % 6 == 1:
            map = followed(map, floor_map, survey)
            assert list(violations(map, site.ontology)) == []

    asyncio.run(explore(SimulatedLink(simulation, "Scout"), survey, noted))
    map = followed(map, floor_map, survey)
    things = {
        (thing.type, round(thing.x, 1), round(thing.y, 1)): thing
        for view in views
        for thing in things_on(floor_map, [sighting for sighting in view.sightings if not (sighting.robot or sighting.furniture)])
    }
    places = [{"PositionX": thing.x, "PositionY": thing.y, "PositionZ": thing.z} for thing in things.values()]
    objects = [Object(name=f"Thing{n}", type=thing.type, values=dict(places[n])) for n, thing in enumerate(things.values())]
    with_things = map.changed([ObjectAdded(object) for object in objects])
    comparison = compare(with_things, world.map, world.ontology)
    print(f"{len(views)} looks in {simulation.time:.0f} s; {comparison}")
    draw(survey.grid(), with_things, world.map, world.ontology, Path(os.environ.get("PICTURE", tmp_path / "office.png")))
    assert comparison.walls >= 0.95
    assert comparison.invented <= 0.05
    assert comparison.rooms == (2, 2)
    assert comparison.furniture == (8, 8)
    assert comparison.things == (3, 3)
    assert [object.type for object in map.objects.values()].count("Door") == 1
    assert find_mistakes(map, site.ontology) == []


def followed(map: Map, floor_map: FloorMap, survey: Survey) -> Map:
    """The map with what the survey shows."""
    return map.changed(floor_map.follow(building_of(survey.grid(), survey.furniture()), survey.pieces, survey.robots))

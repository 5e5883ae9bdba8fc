"""Has a robot explore a floor in a simulation in the same process, as fast as it goes, and compares its map with the building."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from somrs.adapters.mapping.doors import DrivenDoor
from somrs.adapters.mapping.exploring import explore
from somrs.adapters.mapping.floor_map import FloorMap, Shown
from somrs.adapters.mapping.reporting import things_on
from somrs.adapters.mapping.survey import Survey
from somrs.devices.simulator.link.commands import CommandDone
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.map import Map
from somrs.ontology.objects import Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import Ontology
from somrs.sites.occupancy.building import building_of
from somrs.sites.plan import Box, Point
from somrs.space.findings import Finding, find_mistakes
from somrs.space.solids import Solid, solid_of
from tests.support.map_comparison import Comparison, compare
from tests.support.simulated_link import SimulatedLink

ROBOT = "Scout"
"""The robot that explores."""
_DEPTH_BELOW, _HEIGHT_ABOVE = 1.0, 3.5
"""What is at most so far below and above a storey's floor belongs to it, m."""


def storey(building: Map, ontology: Ontology, elevation: float, start: tuple[float, float], *, doors_open: bool) -> Map:
    """A storey of a building with its doors like this, and one robot there."""

    def is_kept(object: Object) -> bool:
        height = object.values.get("PositionZ", elevation)
        is_on_storey = isinstance(height, int | float) and elevation - _DEPTH_BELOW <= height < elevation + _HEIGHT_ABOVE
        return is_on_storey and not ontology.is_subtype(object.type, "MobileRobot")

    map = building.changed([ObjectRemoved(name) for name, object in building.objects.items() if not is_kept(object)])
    doors = [name for name in _driven_doors(map, ontology) if map.objects[name].type != "LiftDoor"]
    pose = {"PositionX": start[0], "PositionY": start[1], "PositionZ": elevation, "RotationZ": 0.0, "Speed": 0.8, "FieldOfView": math.tau}
    robot = Object(name=ROBOT, type="PatrolRobot", values=dict(pose))
    return map.changed([ObjectAdded(robot), *(ValueSet(name, "Open", doors_open) for name in doors)])


def _driven_doors(map: Map, ontology: Ontology) -> list[str]:
    return [name for name, object in map.objects.items() if ontology.is_subtype(object.type, "PoweredDoor")]


class SimulatedDoors:
    """The doors with a drive of a simulation in the same process, opened at once. `works`: or they fail."""

    def __init__(self, simulation: Simulation, boxes: dict[str, Box], *, works: bool = True) -> None:
        self.simulation, self.boxes, self.works = simulation, boxes, works
        self.moves: list[str] = []

    async def shut(self) -> list[DrivenDoor]:
        return [DrivenDoor(name=name, box=box) for name, box in self.boxes.items() if not self.simulation.observe(name).open]

    async def open(self, name: str) -> bool:
        self.moves.append(f"open {name}")
        if self.works:
            await SimulatedLink.of_device(self.simulation, name).open_doors(name)
        return self.works

    async def close(self, name: str) -> bool:
        self.moves.append(f"close {name}")
        await SimulatedLink.of_device(self.simulation, name).close_doors(name)
        return True


@dataclass(kw_only=True)
class ExploredFloor:
    """A floor, and what a robot has made of it. `true`: the floor as it is; `made`: the map, at first what is known of the floor."""

    true: Map
    ontology: Ontology
    made: Map
    elevation: float = 0.0
    views: list[CommandDone] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.simulation = Simulation(self.true, self.ontology, WorldKind.KINEMATIC)
        robot = solid_of(self.true.objects[ROBOT], self.ontology)
        assert robot is not None
        self.survey = Survey(robot.radius)
        doors = {name: _box(self._solid(name)) for name in _driven_doors(self.true, self.ontology)}
        self.made = self.made.changed([ObjectAdded(self.true.objects[name]) for name in doors if name not in self.made.objects])
        self.floor_map = FloorMap("Ground", self.elevation, self.made.objects)
        for name, box in doors.items():
            self.floor_map.add_foreign(name, Shown(kind="Door", box=box, values=self.true.objects[name].values), is_device=True)
        self.doors = SimulatedDoors(self.simulation, doors)

    def _solid(self, name: str) -> Solid:
        solid = solid_of(self.true.objects[name], self.ontology)
        assert solid is not None
        return solid

    def explore(self, follow_every: int | None = None, followed: Callable[[Map], None] = lambda map: None) -> None:
        """Explore the floor. The map follows after so many looks, if stated, and at the end; `followed` gets it."""

        async def note(view: CommandDone) -> None:
            self.views.append(view)
            if follow_every is not None and len(self.views) % follow_every == 1:
                followed(self.follow())

        asyncio.run(explore(SimulatedLink(self.simulation, ROBOT), self.survey, note, doors=self.doors))
        followed(self.follow())

    def follow(self) -> Map:
        """Bring the map up to date with the survey."""
        building = building_of(self.survey.grid(), self.survey.furniture(), self.floor_map.known_doors)
        self.made = self.made.changed(self.floor_map.follow(building, self.survey.pieces, self.survey.robots))
        return self.made

    @property
    def mistakes(self) -> list[Finding]:
        """What `somrs check` would say of the map."""
        return find_mistakes(self.made, self.ontology)

    @property
    def with_things(self) -> Map:
        """The map with the things that were seen on furniture and on the floor."""
        things = {
            (thing.type, round(thing.x, 1), round(thing.y, 1)): thing
            for view in self.views
            for thing in things_on(self.floor_map, [sighting for sighting in view.sightings if not (sighting.robot or sighting.furniture)])
        }
        places = [{"PositionX": thing.x, "PositionY": thing.y, "PositionZ": thing.z} for thing in things.values()]
        objects = [Object(name=f"Thing{n}", type=thing.type, values=dict(places[n])) for n, thing in enumerate(things.values())]
        return self.made.changed([ObjectAdded(object) for object in objects])

    def compare(self, rooms: Sequence[Point] | None = None) -> Comparison:
        """The map against the floor, as far as the robot can come there. `rooms`: a point in each room, None: in each of the true map."""
        values = self.true.objects[ROBOT].values
        x, y = (value if isinstance(value := values[path], int | float) else 0.0 for path in ("PositionX", "PositionY"))
        comparison = compare(self.with_things, self.true, self.ontology, (x, y), rooms)
        print(f"{len(self.views)} looks in {self.simulation.time:.0f} s; {comparison}; {len(self.mistakes)} mistakes")
        return comparison


def _box(solid: Solid) -> Box:
    return Box(solid.x, solid.y, solid.width, solid.depth, solid.yaw)

"""What is to be done in a building: jars are to be brought elsewhere, or, without anything to carry, robots are to go to places."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from somrs.devices.simulator.link.lines import HANDLES, PathStop, StandAt
from somrs.devices.simulator.server.driving_distances import find_legs
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import UsageError
from somrs.ontology.files.loaded import LoadedModel
from somrs.ontology.files.loading import load
from somrs.ontology.map import Map
from somrs.space.free_space import FreeSpace
from somrs.space.solids import Point, Role, Solid, solid_of

INSET = 0.08
"""How far from the edge of a table a jar stands, m."""
HIGHEST = 1.3
"""Tables and shelves that are higher are left out, m."""
SAME_STOREY = 1.0
ROOM = 0.45
"""The room of robots that are put into a building, m."""
APART = 1.0
"""How far apart they are, m."""


@dataclass(frozen=True, slots=True)
class Delivery:
    """A jar at a point on a support, and the support to which it is to be brought. `crosses`: whether that is on another storey."""

    jar: str
    support: str
    point: tuple[float, float, float]
    goal: str
    crosses: bool

    @property
    def formula(self) -> str:
        return f"{self.jar} isOn {self.goal}"


@dataclass(frozen=True, slots=True)
class Trip:
    """A robot that is to go to a named place. `crosses`: whether that is on another storey."""

    robot: str
    place: str
    crosses: bool

    @property
    def formula(self) -> str:
        return f"{self.robot} isAt {self.place}"


def errands(site: Sequence[Path], count: int, seed: int) -> Sequence[Delivery | Trip]:
    """Random deliveries among the supports that robots which carry things reach; half of them to another storey, where there is one. In a
    building without such supports, trips of robots to places that they reach.

    Raises UsageError for a building in which there is neither.
    """
    model = load(site)
    if model.map is None:
        raise UsageError(f"{site[0]} is an ontology without a map")
    simulation = Simulation(model.map, model.ontology, WorldKind.KINEMATIC)
    carriers = [name for name, robot in simulation.robots.items() if robot.size.gripper and _carries(model, robot.solid)]
    chance = random.Random(seed)
    supports = [solid for solid in simulation.scene.world.solids.values() if solid.role is Role.SUPPORT and solid.height < HIGHEST]
    chance.shuffle(supports)
    chosen: list[Delivery] = []
    reached: dict[str, bool] = {}

    def is_reached(support: Solid) -> bool:
        if support.name not in reached:
            reached[support.name] = _is_reached(simulation, carriers, support.name)
        return reached[support.name]

    for support in supports:
        if len(chosen) == count:
            break
        points = ((x, y, support.z) for x, y in _edge_points(support))
        spot = next((point for point in points if is_reached(support) and _is_reached(simulation, carriers, point)), None)
        if spot is None:
            continue
        wants_crossing = len(chosen) < (count + 1) // 2
        goals = sorted(
            (goal for goal in supports if goal is not support),
            key=lambda goal: ((abs(goal.z - support.z) > SAME_STOREY) != wants_crossing, chance.random()),
        )
        goal = next((goal for goal in goals if is_reached(goal)), None)
        if goal is not None:
            jar, point = f"Jar{len(chosen) + 1}", (round(spot[0], 3), round(spot[1], 3), round(support.top, 3))
            chosen.append(Delivery(jar, support.name, point, goal.name, abs(goal.z - support.z) > SAME_STOREY))
    errands = chosen or _trips(model.map, simulation, count, chance)
    if not errands:
        raise UsageError(f"{site[0]}: there is nothing that a robot could deliver, and no place to which one could go")
    return errands


def _trips(map: Map, simulation: Simulation, count: int, chance: random.Random) -> list[Trip]:
    robots, solids = [*simulation.robots.values()], simulation.scene.world.solids
    places = [name for name, object in map.objects.items() if object.type == "Place" and name in solids]
    pairs = [(robot, place) for robot in robots for place in places]
    chance.shuffle(pairs)
    chosen: list[Trip] = []
    for robot, place in pairs:
        if len(chosen) == count:
            break
        solid = solids[place]
        if _is_reached(simulation, [robot.name], StandAt(solid.x, solid.y, solid.z)):
            chosen.append(Trip(robot.name, place, abs(robot.solid.z - solid.z) > SAME_STOREY))
    return chosen


def further_robots(site: Path, count: int, seed: int) -> str:
    """A site file with robots at places of a building that has none, to be loaded together with the building's; empty if it has some.

    Raises UsageError for a building without places where they have room.
    """
    model = load([site])
    if model.map is None or any(model.ontology.is_subtype(object.type, "MobileRobot") for object in model.map.objects.values()):
        return ""
    solids = [solid for object in model.map.objects.values() if (solid := solid_of(object, model.ontology)) is not None]
    places = [solid for solid in solids if model.ontology.is_subtype(solid.type, "Waypoint")]
    random.Random(seed).shuffle(places)
    lifts = [solid for solid in solids if solid.role is Role.LIFT]
    spots: list[tuple[float, float, float]] = []
    spaces: dict[float, FreeSpace] = {}
    for place in places:
        x, y, z = place.x, place.y, place.z
        if z not in spaces:
            spaces[z] = FreeSpace(model.map, model.ontology, level=z)
        has_room = spaces[z].clearance((x, y)) > ROOM and all(lift.distance(x, y) > ROOM for lift in lifts)
        if len(spots) < count and has_room and all(math.dist((x, y, z), spot) > APART for spot in spots):
            spots.append((x, y, z))
    if not spots:
        raise UsageError(f"{site}: there is no place with room for a robot")
    robots = (f"  Robot{number}: {{type: DeliveryRobot, at: {[*spot]}}}" for number, spot in enumerate(spots, 1))
    return "\n".join(["map: Robots", "objects:", *robots]) + "\n"


def site_of(chosen: Sequence[Delivery]) -> str:
    """The jars as a site file, to be loaded together with the building's."""
    lines = ["map: Jars", "objects:"]
    lines += [f"  {delivery.jar}: {{type: Jar, at: {[*delivery.point]}}}" for delivery in chosen]
    lines += ["facts:", *(f"  - {delivery.jar} isOn {delivery.support}" for delivery in chosen)]
    return "\n".join(lines) + "\n"


def _carries(model: LoadedModel, robot: Solid) -> bool:
    return str(model.ontology.driver(robot.type)).endswith(":Manipulator")


def _edge_points(support: Solid) -> Iterator[Point]:
    width, depth = support.extent, support.extent
    if support.form == "Box":
        width, depth = support.width / 2, support.depth / 2
    for x, y in ((0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0)):
        yield support.world(x * max(width - INSET, 0.0), y * max(depth - INSET, 0.0))


def _is_reached(simulation: Simulation, carriers: list[str], stop: PathStop) -> bool:
    """Whether one of the robots gets there, by doors that one of them can open."""
    ways = [find_legs(simulation, carrier, (stop,)) for carrier in carriers]
    shut_doors = {door for way in ways for door in way.shut}
    opened = {door for door in shut_doors if any(None not in find_legs(simulation, name, (door + HANDLES,)).lengths for name in carriers)}
    return any(None not in way.lengths and opened.issuperset(way.shut) for way in ways)

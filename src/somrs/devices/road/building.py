"""The building as robots of any make see it: the map, and the roadmap of traffic. Where they can stand, and which ways lead there.

It answers the same questions for them as the simulation does for simulated robots (`DrivenWorld`), from what the map says.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from somrs.devices.simulator.link.commands import ObjectState
from somrs.devices.simulator.motion.driven_world import Driver
from somrs.devices.simulator.motion.driving import MARGIN, NEAR_FLOOR
from somrs.devices.simulator.motion.placement import reaching_bases
from somrs.devices.simulator.world.layout import Layout
from somrs.errors import UsageError
from somrs.ontology.map import Map
from somrs.ontology.modes import closed_passages
from somrs.ontology.objects import Object
from somrs.ontology.types import Ontology
from somrs.protocol.messages.traffic import Berth, RoadmapPlace
from somrs.space.clearance import Disc
from somrs.space.dimensions import Dimensions, dimensions_of
from somrs.space.distances import Array, distances_from
from somrs.space.edges import edge_targets
from somrs.space.free_space import FreeSpace
from somrs.space.lanes import lanes_of
from somrs.space.solids import CARRYING, Point, Role, Solid, solid_of
from somrs.space.zones import Zones, zones_of
from somrs.traffic.layout import OpenBuilding
from somrs.traffic.roadmap import Lane, NumberedRoadmap, Place, Roadmap, RobotKind, spacing_for
from somrs.traffic.robot_tasks import RoadmapRead, Standing
from somrs.traffic.surroundings import TOLERANCE
from somrs.traffic.ways import Ways, in_sight

AT_PLACE = 0.05
"""A robot that is this near to a place of the roadmap is there, m."""
EDGE = 0.1
"""Distance from the edge of a support at which things are taken to be put, m."""
INEXACT = 0.06
"""How far from where it is to stand a robot may be, m."""
FLOOR_HEIGHT = 0.1
"""Difference in height up to which a point is on a floor, m."""
APART = 0.02
"""Distance between two things on a support, m."""
HAND = 0.05
"""Radius of a thing of which the map says nothing, m."""
MOST_STANDS = 24
"""How many stands are tried until one is clear."""

Pose = tuple[float, float, float, float]


@dataclass(slots=True)
class RoadDriver:
    """A robot for which ways are found. `position`: its pose in metres and radians; `level`: the height of its floor; `holding`: what it
    holds."""

    name: str
    solid: Solid
    position: tuple[float, float, float]
    level: float
    holding: str | None = None

    @property
    def size(self) -> Dimensions:
        return dimensions_of(self.solid)

    @property
    def kind(self) -> RobotKind:
        return RobotKind(self.size.radius, self.solid.graph)

    def pose(self) -> tuple[float, float, float]:
        return self.position


@dataclass(frozen=True, slots=True)
class Stand:
    """Where a robot stands to work: its point, the point that it reaches from there, and the heading towards that."""

    base: Point
    spot: Point

    @property
    def yaw(self) -> float:
        return math.atan2(self.spot[1] - self.base[1], self.spot[0] - self.base[0])


class Building:
    """The building on a map, with the roadmap that traffic has. Call `update` before each question; what has not changed is kept."""

    def __init__(self) -> None:
        self._map, self._ontology = Map([]), Ontology()
        self._edition: int | None = None
        self.solids: dict[str, Solid] = {}
        self._solids: dict[str, tuple[Object, Solid | None]] = {}
        self._static_key: object = None
        self._ways_key: object = None
        self._layout: Layout | None = None
        self._ways: Ways | None = None
        self._roadmap: NumberedRoadmap | None = None
        self.noted: dict[str, ObjectState] = {}
        """Things that are elsewhere than the map has them, as a robot has found in work that it has not reported yet."""

    # What changes

    def update(self, map: Map, ontology: Ontology, roadmap: RoadmapRead) -> None:
        """Take over the map as it is, and the roadmap. Raises UsageError for a roadmap that cannot be used; the one from before stays."""
        if map is self._map and roadmap.edition == self._edition:
            return
        if ontology is not self._ontology:
            self._solids = {}
        self._map, self._ontology = map, ontology
        known_solids = self._solids
        self._solids = {
            name: entry if (entry := known_solids.get(name)) is not None and entry[0] is object else (object, solid_of(object, ontology))
            for name, object in map.objects.items()
        }
        self.solids = {name: solid for name, (_, solid) in self._solids.items() if solid is not None}
        static_solids = tuple(solid for solid in self.solids.values() if solid.role not in (Role.THING, Role.ROBOT))
        if static_solids != self._static_key:
            self._static_key, self._layout = static_solids, Layout(ontology)
            self._layout.solids = {solid.name: solid for solid in static_solids}
        self._renew_ways(roadmap, static_solids)

    def _renew_ways(self, roadmap: RoadmapRead, static_solids: tuple[Solid, ...]) -> None:
        lanes = lanes_of(self._map, self._ontology)
        # The cabin of a lift is at all its landings, wherever it is now.
        heights = [None if solid.role is Role.LIFT else solid.z for solid in static_solids]
        opened = tuple(
            (solid.name, solid.x, solid.y, height, solid.yaw, solid.role) for solid, height in zip(static_solids, heights, strict=True)
        )
        if (opened, lanes, roadmap.edition) == self._ways_key:
            return
        levels = sorted({place.level for place in roadmap.places})
        building = OpenBuilding(self._map, self._ontology, levels, lanes)
        numbered = NumberedRoadmap(_roadmap_of(roadmap.places, building))
        self._roadmap, self._ways = numbered, Ways(numbered, building.spaces, building.doors)
        self._ways_key, self._edition = (opened, lanes, roadmap.edition), roadmap.edition

    @property
    def roadmap(self) -> NumberedRoadmap:
        assert self._roadmap is not None, "it was updated"
        return self._roadmap

    # The world through which robots drive

    def ways(self) -> Ways:
        assert self._ways is not None, "it was updated"
        return self._ways

    def pose(self, name: str) -> Pose:
        if (noted := self.noted.get(name)) is not None:
            return noted.x, noted.y, noted.z, noted.yaw
        solid = self.solids[name]
        return solid.x, solid.y, solid.z, solid.yaw

    def container(self, name: str) -> str | None:
        return next((fact.arguments[1] for fact in self._map.facts("isIn") if fact.arguments[0] == name), None)

    def clearances(self, points: Array, low: float, high: float, ignored: Iterable[str] = ()) -> Array:
        assert self._layout is not None, "it was updated"
        skipped, distances = set(ignored), np.full(len(points), 2.0)
        if not len(points):
            return distances
        (left, bottom), (right, top) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        for block in self._layout.blocks_near((left - 2.0, bottom - 2.0, right + 2.0, top + 2.0)):
            if block.z < high and block.top > low and block.name not in skipped:
                distances = np.minimum(distances, distances_from(block, points))
        return distances

    def has_leaves(self, owner: str) -> bool:
        """Robots of other makes move no doors."""
        return False

    def leaf_ways(self, owner: str, is_open: bool) -> tuple[tuple[float, float], ...]:
        return ()

    def leaf_bases(self, driver: Driver, owner: str, ways: Sequence[tuple[float, float]], level: float) -> list[Array]:
        return []

    @property
    def doors_for_all(self) -> Collection[str]:
        closed = self._closed_passages
        return {name for name, door in self.ways().doors.items() if door.automatic and name not in closed}

    @property
    def unusable_doors(self) -> Collection[str]:
        return self._closed_passages

    @property
    def unusable_lifts(self) -> Collection[str]:
        return self._closed_passages & self.roadmap.zones.keys()

    @property
    def _closed_passages(self) -> set[str]:
        return {*closed_passages(self._map, self._ontology)}

    @property
    def zones(self) -> Zones:
        return zones_of(self._map, self._ontology)

    def standing(self, driver: Driver) -> Iterator[tuple[float, Disc]]:
        """Robots that cannot move, and things on the floor: traffic lets nobody drive there."""
        for thing in self.solids.values():
            level = self.level_of(thing.z)
            if thing.role is Role.THING and -0.1 < thing.z - level < NEAR_FLOOR:
                yield level, Disc(thing.x, thing.y, thing.extent)
        for name in self._map.with_value("Working", False):
            solid = self.solids.get(name)
            if solid is not None and solid.role is Role.ROBOT and name != driver.name:
                yield solid.z, Disc(solid.x, solid.y, dimensions_of(solid).radius)

    def is_free(self, point: Point, level: float) -> bool:
        """Whether something can stand at a point of a floor, as far as is known."""
        space = self._ways.space(self.level_of(level)) if self._ways is not None else None
        return space is None or space.is_clear(point, point, 0.0)

    # Where robots stand, and things

    def support_of(self, thing: str) -> str | None:
        """What a thing is on, or in; None if the map does not say so."""
        if thing in self.noted:
            return self.noted[thing].support
        facts = (fact for relation in ("isOn", "isIn") for fact in self._map.facts(relation))
        return next((fact.arguments[1] for fact in facts if fact.arguments[0] == thing), None)

    def supports_near(self, driver: RoadDriver) -> list[str]:
        """The objects on which robots can put things, the nearest to a robot first; those on other floors come last."""
        (x, y, _), level = driver.position, self.level_of(driver.level)
        supports = (solid for solid in self.solids.values() if solid.role is Role.SUPPORT)
        return [solid.name for solid in sorted(supports, key=lambda solid: (self.level_of(solid.z) != level, solid.distance(x, y)))]

    def mark_at(self, point: Point, level: float) -> str:
        """The Place of the map that is at a point; empty if there is none."""
        marks = (solid for solid in self.solids.values() if solid.role is Role.MARK and abs(solid.z - level) < FLOOR_HEIGHT)
        near = [(distance, solid.name) for solid in marks if (distance := math.dist((solid.x, solid.y), point)) <= AT_PLACE]
        return min(near)[1] if near else ""

    def floor_at(self, x: float, y: float, level: float) -> str | None:
        """The floor at a point; None if the map has none there."""
        floors = (solid for solid in self.solids.values() if solid.role is Role.FLOOR and abs(solid.top - level) < FLOOR_HEIGHT)
        return next((solid.name for solid in floors if solid.distance(x, y) <= 0.0), None)

    def support_at(self, point: Point, level: float) -> str | None:
        """The piece of furniture at a point of a floor, or up to `EDGE` beside it; None: there is none."""
        supports = (solid for solid in self.solids.values() if solid.role is Role.SUPPORT and abs(solid.z - level) < FLOOR_HEIGHT)
        return next((solid.name for solid in supports if solid.distance(*point) <= EDGE), None)

    def top_of(self, support: str) -> float:
        """The height at which things stand on an object, m."""
        solid = self.solids[support]
        return solid.z if solid.role is Role.MARK else solid.top

    def spot_on(self, support: str, point: Point) -> Point:
        """The point on a support that is nearest to another one, m."""
        solid = self.solids[support]
        spots = [spot for spot, _ in edge_targets(solid, EDGE)] if solid.role is Role.SUPPORT else []
        return min(spots or [(solid.x, solid.y)], key=lambda spot: math.dist(spot, point))

    def has_room(self, support: str, spot: Point, thing: str | None) -> bool:
        """Whether nothing else on a support is where a thing would be put; None: it is only reached for."""
        solid = self.solids.get(thing) if thing is not None else None
        if thing is None or support not in self.solids or self.solids[support].role not in CARRYING:
            return True
        radius = APART + (solid.extent if solid is not None else HAND)
        return all(
            math.dist((solid.x, solid.y), spot) >= radius + solid.extent
            for name, _ in self._map.facts_with("isOn", 1, support)
            if name != thing and (solid := self.solids.get(name)) is not None and solid.role is Role.THING
        )

    def level_of(self, height: float) -> float:
        """The floor that is nearest to a height, m."""
        return min(self.ways().levels, key=lambda level: abs(level - height), default=0.0)

    def stop_at(self, driver: RoadDriver, point: Point, name: str, avoided: Collection[str] = ()) -> Berth | str | None:
        """The place of the roadmap at a point on the robot's floor, or a berth there with this name, from which it sees other
        places; None if it sees none. `avoided`: places to which it cannot drive."""
        near_places = self._near_places(driver, point)
        if near_places and near_places[0][0] <= AT_PLACE and not avoided:
            return near_places[0][1]
        space = self.ways().space(driver.level)
        if space is None:
            return None
        names = [place for _, place in near_places if place not in avoided]
        points = np.array([self.point(place) for place in names]).reshape(-1, 2)
        clear = in_sight(space, driver.size.radius, np.broadcast_to(np.array(point), points.shape), points)
        places = tuple(place for place, is_clear in zip(names, clear, strict=True) if is_clear)
        return Berth(name=name, x=point[0], y=point[1], radius=driver.size.radius, places=places) if places else None

    def _near_places(self, driver: RoadDriver, point: Point) -> list[tuple[float, str]]:
        roadmap, kind = self.roadmap, self.roadmap.kind_for(driver.kind)
        level = self.level_of(driver.level)
        return sorted(
            (distance, place.name)
            for number in roadmap.near(point, level)
            if (place := roadmap.roadmap.places[number]).kind == kind
            and (distance := math.dist((place.x, place.y), point)) <= roadmap.spacing(number) + TOLERANCE
        )

    def point(self, place: str) -> Point:
        """Where a place of the roadmap is, m."""
        road_place = self.place(place)
        return road_place.x, road_place.y

    def place(self, name: str) -> Place:
        return self.roadmap.roadmap.places[self.roadmap.numbers[name]]

    def lane(self, start: str, end: str) -> Lane | None:
        """The rules for driving from a place to the next, if there are any."""
        numbers = self.roadmap.numbers
        return self.roadmap.rules.get((numbers[start], numbers[end])) if start in numbers and end in numbers else None

    def stands(self, driver: RoadDriver, target: str) -> Iterator[Stand]:
        """Where the robot can stand to reach an object, or the top of one; the nearest that are easy to reach first. Raises UsageError."""
        if target not in self.solids:
            raise UsageError(f"the map does not say where {target} is")
        solid, (x, y, z, _) = self.solids[target], self.pose(target)
        is_carrier = solid.role in CARRYING and solid.role not in (Role.MARK, Role.FLOOR)
        points = [point for point, _ in edge_targets(solid, EDGE)] if is_carrier else [(x, y)]
        spots = np.array([point for point in points if self.has_room(target, point, driver.holding)], dtype=float).reshape(-1, 2)
        top = solid.top if is_carrier else z
        space = self.ways().space(driver.level)
        if space is None:
            return
        bases, reached, costs = reaching_bases(driver.size, self.clearances, spots, top, np.zeros(len(spots)), space.clearances)
        distances = np.hypot(bases[:, 0] - driver.position[0], bases[:, 1] - driver.position[1])
        is_clear, reaches = self._clear_of_things(driver, space, target), np.hypot(*(bases - reached).T)
        costs = costs + 10.0 * ((reaches < driver.size.nearest + INEXACT) | (reaches > driver.size.farthest - INEXACT))
        found = 0
        for index in np.argsort(costs + 0.3 * distances, kind="stable").tolist():
            base = (float(bases[index][0]), float(bases[index][1]))
            if is_clear(base):
                yield Stand(base, (float(reached[index][0]), float(reached[index][1])))
                found += 1
                if found >= MOST_STANDS:
                    return

    def _clear_of_things(self, driver: RoadDriver, space: FreeSpace, target: str) -> Callable[[Point], bool]:
        """Whether nothing on the floor, and no robot that is known to stand, is where the robot would stand."""
        discs = [
            Disc(solid.x, solid.y, solid.extent if solid.role is Role.THING else dimensions_of(solid).radius + MARGIN)
            for solid in self.solids.values()
            if solid.role in (Role.THING, Role.ROBOT)
            and solid.name not in (target, driver.name)
            and -0.1 < solid.z - driver.level < NEAR_FLOOR
        ]
        return lambda point: space.free(point, driver.size.radius + MARGIN + 0.01, discs)


def _roadmap_of(road_places: Sequence[RoadmapPlace], building: OpenBuilding) -> Roadmap:
    """The roadmap as traffic has it."""
    places = tuple(
        Place(
            name=place.name,
            x=place.x,
            y=place.y,
            level=place.level,
            zone=place.zone,
            radius=place.radius,
            spacing=spacing_for(place.radius),
            graph=place.graph,
            passthrough=place.passthrough,
        )
        for place in road_places
    )
    lanes = tuple(
        Lane(start=place.name, end=lane.end, seconds=lane.seconds, speed_limit=lane.speed_limit, travel=lane.travel)
        for place in road_places
        for lane in place.lanes
    )
    doors = tuple(door for door in building.doors.values() if door.automatic)
    graphs = tuple(sorted({place.graph for place in places if place.graph is not None}))
    return Roadmap(places=places, lanes=lanes, lifts=tuple(shaft.name for shaft in building.shafts), doors=doors, graphs=graphs)


def standing(place: Berth | str, halts: int) -> Standing:
    """Where a robot is, for its program in traffic."""
    berths = (place,) if isinstance(place, Berth) else ()
    return Standing(place=place.name if isinstance(place, Berth) else place, berths=berths, halts=halts)

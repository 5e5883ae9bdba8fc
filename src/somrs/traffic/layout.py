"""Roadmaps of a building, from its free space (`storey_layout.py`) and its lanes (`lane_layout.py`)."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from msgspec import Struct, structs
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from somrs.ontology.map import Map
from somrs.ontology.objects import ValueSet
from somrs.ontology.types import Ontology
from somrs.space.free_space import FreeSpace
from somrs.space.lanes import MapLane, graph_of, lanes_for
from somrs.space.shafts import SAME_FLOOR, Shaft, shafts_of
from somrs.space.solids import Point, Role, Solid, solid_of
from somrs.traffic.lane_layout import OPPOSITE, LaneLayout, Rule
from somrs.traffic.roadmap import Lane, Place, Roadmap, RobotKind, spacing_for
from somrs.traffic.storey_layout import StoreyLayout

SAME_SIZE = 1.25
"""By what factor the radii of robots that share places differ at most."""
MARGIN = 0.03
"""The distance of robots from obstacles, in metres."""
DOOR_ROOM = 0.1
"""The distance from the doors of a lift that robots keep while these may move, in metres."""
DOORS = 6.0
"""The time that a lift takes to shut its doors and open them again, in seconds."""
SPEED = 0.8
"""The speed that the time for a lane is computed with, in metres per second."""


ASIDE = 2.0
"""By what factor ways beside the lanes count as longer for robots that keep to lanes."""


class OpenBuilding:
    """The space of a building with all doors open: of the floors at these heights, and of those to which lifts lead from there. `lanes`:
    those on which robots drive."""

    def __init__(self, map: Map, ontology: Ontology, levels: Iterable[float], lanes: Sequence[MapLane] = ()) -> None:
        solids = [solid for object in map.objects.values() if (solid := solid_of(object, ontology)) is not None]
        self.shafts = [shaft for shaft in shafts_of(map, ontology) if shaft.landings]
        in_lifts = {door.name for shaft in self.shafts for landing in shaft.landings for door in landing.doors}
        self.doors = {solid.name: solid for solid in solids if solid.role is Role.DOOR and solid.name not in in_lifts}
        """Without those of lifts."""
        self.lanes = lanes
        self.passages = [solid for solid in solids if ontology.is_subtype(solid.type, "Passage")]
        opened = map.changed([ValueSet(solid.name, "Open", True) for solid in solids if solid.role is Role.DOOR])
        self.spaces = {level: FreeSpace(opened, ontology, level=level) for level in connected_levels(levels, self.shafts)}
        """By height, the lowest first."""


class Layout(Struct, frozen=True, kw_only=True):
    """A roadmap is to be made of the floors at these heights, and of those to which lifts lead from there, with these lanes, for robots of
    these kinds."""

    map: Map
    ontology: Ontology
    levels: tuple[float, ...]
    kinds: tuple[RobotKind, ...]
    lanes: tuple[MapLane, ...] = ()

    @property
    def building(self) -> OpenBuilding:
        return OpenBuilding(self.map, self.ontology, self.levels, self.lanes)


def lay_out(building: OpenBuilding, kinds: Collection[RobotKind]) -> Roadmap:
    """The roadmap for robots of these kinds. Those of about the same size that use the same lanes share places; others have places and
    lanes of their own."""
    own_places, storeys = kinds_with_places(kinds, building.lanes), _Storeys(building)
    parts = [_lay_out(building, kind, f"{number}." if number else "", storeys) for number, kind in enumerate(own_places)]
    places = (place for part in parts for place in part.places)
    doors = (replace(door, open=True) for door in building.doors.values() if door.automatic)
    return Roadmap(
        places=tuple(places),
        lanes=tuple(lane for part in parts for lane in part.lanes),
        lifts=tuple(shaft.name for shaft in building.shafts),
        doors=tuple(doors),
        graphs=tuple(sorted({lane.graph for lane in building.lanes if lane.graph is not None})),
    )


def kinds_with_places(kinds: Collection[RobotKind], lanes: Sequence[MapLane]) -> list[RobotKind]:
    """The kinds for which there are places of their own, so that there are some for each robot of these kinds: those that use no lanes,
    and the smallest, first."""
    classes = sizes(kind.radius for kind in kinds)
    chosen = {(graph_of(kind.graph, lanes), next(radius for radius in classes if radius >= kind.radius)) for kind in kinds}
    return [RobotKind(radius, graph) for graph, radius in sorted(chosen, key=lambda pair: (pair[0] is not None, pair[0] or "", pair[1]))]


def sizes(radii: Iterable[float]) -> list[float]:
    """The radii for which there are places of their own, the smallest first: each is the largest of some that are about the same."""
    classes: list[float] = []
    for radius in sorted(radii, reverse=True):
        if not classes or radius * SAME_SIZE < classes[-1]:
            classes.append(radius)
    return classes[::-1]


class _Storeys:
    """The floors of a building, which kinds of one size share."""

    def __init__(self, building: OpenBuilding) -> None:
        self._building = building
        self._laid_out: dict[tuple[float, float], StoreyLayout] = {}
        """By level and radius."""

    def layout(self, level: float, radius: float, middles: Sequence[Point]) -> StoreyLayout:
        """The places of a floor for robots of a radius. `middles`: of cabins and passages."""
        if (level, radius) not in self._laid_out:
            space = self._building.spaces[level]
            self._laid_out[level, radius] = StoreyLayout(space, radius + MARGIN, spacing_for(radius), middles)
        return self._laid_out[level, radius]


def _lay_out(building: OpenBuilding, kind: RobotKind, prefix: str, storeys: _Storeys) -> Roadmap:
    """The part of the roadmap for one kind of robots."""
    radius, map_lanes = kind.radius, lanes_for(kind.graph, building.lanes)
    places: list[Place] = []
    lanes: list[Lane] = []
    stops: dict[str, list[Place]] = {}
    for number, level in enumerate(building.spaces):
        passages = [(solid.x, solid.y) for solid in building.passages if abs(solid.z - level) < SAME_FLOOR]
        cabins = [shaft for shaft in building.shafts if shaft.landing(level) is not None]
        storey = storeys.layout(level, radius, [*((shaft.cabin.x, shaft.cabin.y) for shaft in cabins), *passages])
        on_storey = [lane for lane in map_lanes if all(abs(end.level - level) < SAME_FLOOR for end in (lane.start, lane.end))]
        network = LaneLayout(on_storey, storey.spacing, storey.snap, storey.are_clear)
        points, pairs = storey.lay_out(network)
        on_level = [
            Place(
                name=f"P{prefix}{number}/{index}",
                x=x,
                y=y,
                level=level,
                radius=radius,
                spacing=storey.spacing,
                zone=_zone((x, y), level, radius, cabins),
                graph=kind.graph,
                mutexes=tuple(sorted(network.mutexes.get(index, ()))),
                passthrough=index in network.passthrough,
            )
            for index, (x, y) in enumerate(points.tolist())
        ]
        places += on_level
        for (first, second), rule in network.ways(points, pairs).items():
            lanes.append(_lane(on_level[first], on_level[second], rule))
        for shaft in cabins:
            inner = [place for place in on_level if place.zone == shaft.name and _can_ride(place, radius, shaft)]
            if inner:
                middle = shaft.cabin.x, shaft.cabin.y
                stops.setdefault(shaft.name, []).append(min(inner, key=lambda place: math.dist((place.x, place.y), middle)))
    for shaft in building.shafts:
        for start, end in combinations(stops.get(shaft.name, ()), 2):
            seconds = ride_seconds(shaft.cabin, start.level, end.level)
            lanes += (Lane(start=first.name, end=second.name, seconds=seconds) for first, second in ((start, end), (end, start)))
    return with_ways_back(Roadmap(places=tuple(places), lanes=tuple(lanes)))


def with_ways_back(roadmap: Roadmap) -> Roadmap:
    """The roadmap, with lanes back where one-way lanes lead to places from which a robot could not return."""
    numbers = {place.name: number for number, place in enumerate(roadmap.places)}
    ends = np.array([(numbers[lane.start], numbers[lane.end]) for lane in roadmap.lanes], dtype=int).reshape(-1, 2)
    size = len(roadmap.places)
    network = csr_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (size, size))
    count, regions = connected_components(network, connection="strong")
    _, islands = connected_components(network, directed=False)
    leading_out = np.flatnonzero(regions[ends[:, 0]] != regions[ends[:, 1]])
    if not len(leading_out):
        return roadmap
    place_counts = np.bincount(regions, minlength=count)
    homes = {
        int(island): int(np.argmax(place_counts * (np.bincount(regions[islands == island], minlength=count) > 0))) for island in {*islands}
    }
    is_caught = np.zeros(size, dtype=bool)
    for island in {int(islands[start]) for start in ends[leading_out, 0]}:
        entry = int(np.flatnonzero(regions == homes[island])[0])
        is_caught[breadth_first_order(network, entry, return_predecessors=False)] = True
        is_caught[regions == homes[island]] = False
    chosen = (roadmap.lanes[number] for number in leading_out.tolist() if is_caught[ends[number, 1]])
    backwards = (structs.replace(lane, start=lane.end, end=lane.start, travel=OPPOSITE.get(lane.travel or "")) for lane in chosen)
    return structs.replace(roadmap, lanes=(*roadmap.lanes, *backwards))


def ride_seconds(cabin: Solid, start: float, end: float) -> float:
    """How long a robot in a lift takes from one height to another, with the doors, in seconds."""
    return DOORS + abs(end - start) / cabin.speed


def connected_levels(levels: Iterable[float], shafts: Sequence[Shaft]) -> list[float]:
    """The levels, and those to which lifts lead from them."""
    known = {round(level, 1) for level in levels}
    while True:
        heights = [{round(landing.level, 1) for landing in shaft.landings} for shaft in shafts]
        reached = {height for stops in heights if not known.isdisjoint(stops) for height in stops}
        if reached <= known:
            return sorted(known)
        known |= reached


def _zone(point: Point, level: float, radius: float, cabins: Sequence[Shaft]) -> str | None:
    """The lift in which, or in the way of whose doors, a robot at this point is."""
    return next((shaft.name for shaft in cabins if shaft.contains(point) or shaft.room_to_doors(point, level) < radius + DOOR_ROOM), None)


def _can_ride(place: Place, radius: float, shaft: Shaft) -> bool:
    """Whether the doors of the lift can shut while a robot is at this place."""
    point = place.x, place.y
    return shaft.contains(point) and shaft.room_to_doors(point, place.level) > radius + DOOR_ROOM


def _lane(start: Place, end: Place, rule: Rule) -> Lane:
    seconds = math.dist((start.x, start.y), (end.x, end.y)) / min(SPEED, rule.speed_limit or SPEED) * (ASIDE if rule.is_aside else 1)
    return Lane(start=start.name, end=end.name, seconds=max(seconds, 0.05), speed_limit=rule.speed_limit, travel=rule.travel)

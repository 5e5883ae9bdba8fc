"""Roadmaps from the free space of a building, and from its lanes (`lane_layout.py`).

The places lie on a lattice of equal triangles, as far apart as the spacing: six ways lead on from each, and no two places of the lattice
exclude each other. Where walls and furniture leave no room for the lattice, places are added until every free point sees one.

If all lanes are at most as long as the spacing s, two robots that hold places which do not exclude each other, and drive on the lanes
between their own, stay at least s·√3/2 apart: the farthest that a lane comes towards a place at distance s from both its ends.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from msgspec import Struct, structs
from scipy import ndimage
from scipy.sparse import coo_array, csr_array, eye_array
from scipy.sparse.csgraph import breadth_first_order, connected_components
from scipy.spatial import cKDTree

from somrs.ontology.map import Map
from somrs.ontology.objects import ValueSet
from somrs.ontology.types import Ontology
from somrs.space.free_space import FreeSpace
from somrs.space.lanes import MapLane, graph_of, lanes_for
from somrs.space.shafts import SAME_FLOOR, Shaft, shafts_of
from somrs.space.solids import Point, Role, Solid, solid_of
from somrs.space.squares import Squares, box_around
from somrs.traffic.bays import find_bays
from somrs.traffic.coverage import UNSEEN, Coverage, Crossings, Points
from somrs.traffic.lane_layout import OPPOSITE, AreClear, LaneLayout, Rule
from somrs.traffic.roadmap import Lane, Place, Roadmap, RobotKind, spacing_for

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
PLACES = 4000
"""About how many places a floor has at most; on larger floors they are farther apart."""
WIDEST = 2.0
"""The largest spacing of places, in metres."""
SMALLEST = 0.3
"""Free areas smaller than this are left out, in square metres."""
HOPS = 4
"""Places that are next to each other on the ground are at most so many lanes apart; a power of two."""


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


def lay_out(building: OpenBuilding, kinds: Iterable[RobotKind]) -> Roadmap:
    """The roadmap for robots of these kinds. Those of about the same size that use the same lanes share places; others have places and
    lanes of their own."""
    own_places = kinds_with_places(kinds, building.lanes)
    parts = [_lay_out(building, kind, f"{number}." if number else "") for number, kind in enumerate(own_places)]
    places = (place for part in parts for place in part.places)
    doors = (replace(door, open=True) for door in building.doors.values() if door.automatic)
    return Roadmap(
        places=tuple(places),
        lanes=tuple(lane for part in parts for lane in part.lanes),
        lifts=tuple(shaft.name for shaft in building.shafts),
        doors=tuple(doors),
        graphs=tuple(sorted({lane.graph for lane in building.lanes if lane.graph is not None})),
    )


def kinds_with_places(kinds: Iterable[RobotKind], lanes: Sequence[MapLane]) -> list[RobotKind]:
    """The kinds for which there are places of their own, so that there are some for each robot of these kinds: those that use no lanes,
    and the smallest, first."""
    radii: dict[str | None, list[float]] = {}
    for kind in kinds:
        radii.setdefault(graph_of(kind.graph, lanes), []).append(kind.radius)
    graphs = sorted(radii, key=lambda graph: (graph is not None, graph or ""))
    return [RobotKind(radius, graph) for graph in graphs for radius in sizes(radii[graph])]


def sizes(radii: Iterable[float]) -> list[float]:
    """The radii for which there are places of their own, the smallest first: each is the largest of some that are about the same."""
    classes: list[float] = []
    for radius in sorted(radii, reverse=True):
        if not classes or radius * SAME_SIZE < classes[-1]:
            classes.append(radius)
    return classes[::-1]


def _lay_out(building: OpenBuilding, kind: RobotKind, prefix: str) -> Roadmap:
    """The part of the roadmap for one kind of robots."""
    radius, map_lanes = kind.radius, lanes_for(kind.graph, building.lanes)
    places: list[Place] = []
    lanes: list[Lane] = []
    stops: dict[str, list[Place]] = {}
    for number, (level, space) in enumerate(building.spaces.items()):
        passages = [(solid.x, solid.y) for solid in building.passages if abs(solid.z - level) < SAME_FLOOR]
        cabins = [shaft for shaft in building.shafts if shaft.landing(level) is not None]
        storey = _Storey(space, radius + MARGIN, spacing_for(radius))
        on_storey = [lane for lane in map_lanes if all(abs(end.level - level) < SAME_FLOOR for end in (lane.start, lane.end))]
        network = LaneLayout(on_storey, storey.spacing, storey.snap, storey.are_clear)
        points, pairs = storey.lay_out([*((shaft.cabin.x, shaft.cabin.y) for shaft in cabins), *passages], network)
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
    sizes = np.bincount(regions, minlength=count)
    homes = {int(island): int(np.argmax(sizes * (np.bincount(regions[islands == island], minlength=count) > 0))) for island in {*islands}}
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


def _lane(start: Place, end: Place, rule: Rule | None) -> Lane:
    limit, travel = (rule.speed_limit, rule.travel) if rule is not None else (None, None)
    seconds = max(math.dist((start.x, start.y), (end.x, end.y)) / min(SPEED, limit or SPEED), 0.05)
    return Lane(start=start.name, end=end.name, seconds=seconds, speed_limit=limit, travel=travel)


class _Storey:
    """The free space of a storey. `radius`: the clearance that robots need; `spacing`: the least spacing of places for them."""

    def __init__(self, free_space: FreeSpace, radius: float, spacing: float) -> None:
        self._free_space, self._grid, self._radius = free_space, free_space.grid, radius
        labels, count = ndimage.label(free_space.field >= radius, structure=np.ones((3, 3)))
        sizes = np.bincount(labels.ravel(), minlength=count + 1) * self._grid.size**2
        sizes[0] = 0.0
        self._free = (sizes >= SMALLEST)[labels]
        area = np.count_nonzero(self._free) * self._grid.size**2
        self.spacing = max(spacing, min(math.sqrt(area / PLACES * 2 / math.sqrt(3)), WIDEST))
        self._coverage = Coverage(free_space, self._free, radius, self.spacing - self._grid.size)

    @property
    def are_clear(self) -> AreClear:
        return self._coverage.are_clear

    def snap(self, point: Point) -> Point | None:
        """The point, or the nearest one within the spacing where the robot has room; None if there is none."""
        if self._is_free(point):
            return point
        rows, columns = np.nonzero(self._free)
        centres = self._grid.centres(np.stack([rows, columns], axis=1))
        distances = np.hypot(centres[:, 0] - point[0], centres[:, 1] - point[1])
        if not len(distances) or distances.min() > self.spacing:
            return None
        x, y = centres[distances.argmin()].tolist()
        return x, y

    def lay_out(self, middles: Sequence[Point], network: LaneLayout) -> tuple[Points, list[tuple[int, int]]]:
        """The points, those of the lanes first, and the pairs of them that a straight lane joins. `middles`: those of cabins and
        passages."""
        beside = [*middles, *network.sidings()] if network.points else [*middles]
        points = self._spread(network.points, [*filter(self._is_free, beside), *self._lattice()])
        points = self._filled(points)
        crossings = self._coverage.crossings()
        while len(joints := self._joints(points, crossings)):
            points = np.vstack([points, joints])
        bays = find_bays(self._free_space, self._free, points, self._pairs(points), self.spacing, self._coverage.are_clear)
        points = np.vstack([points, bays])
        return points, self._pairs(points)

    def _lattice(self) -> Iterator[Point]:
        grid, step = self._grid, self.spacing * (1 + 1e-9)
        rows = math.ceil(grid.rows * grid.size / (step * math.sqrt(3) / 2))
        columns = math.ceil(grid.columns * grid.size / step) + 1
        for row in range(rows):
            for column in range(columns):
                point = grid.x + (column + row % 2 / 2) * step, grid.y + row * step * math.sqrt(3) / 2
                if self._is_free(point):
                    yield point

    def _is_free(self, point: Point) -> bool:
        cell = self._grid.cell(point)
        return cell is not None and bool(self._free[cell]) and self._free_space.free(point, self._radius)

    def _spread(self, fixed: Sequence[Point], points: Sequence[Point]) -> Points:
        """The fixed points, and the others without those that are nearer to an earlier one than half of the spacing."""
        kept = [*fixed]
        least = self.spacing / 2
        squares = Squares[Point](least)
        for point in fixed:
            squares.add(point, box_around(point, 0.0))
        for point in points:
            if all(abs(point[0] - x) + abs(point[1] - y) >= least for x, y in squares.near(box_around(point, least))):
                kept.append(point)
                squares.add(point, box_around(point, 0.0))
        return np.array(kept, dtype=float).reshape(-1, 2)

    # Places for what the lattice leaves out

    def _filled(self, points: Points) -> Points:
        """The points, and more of them, so that every free cell sees one."""
        coverage = self._coverage
        for number, point in enumerate(points):
            coverage.note(point, number)
        added: list[Point] = []
        for row, column in coverage.unseen().tolist():
            if coverage.seen[row, column] == UNSEEN:
                added.append(self._grid.centre((row, column)))
                coverage.note(added[-1], len(points) + len(added) - 1)
        return np.vstack([points, *added]) if added else points

    def _pairs(self, points: Points) -> list[tuple[int, int]]:
        if len(points) < 2:
            return []
        pairs = cKDTree(points).query_pairs(self.spacing * (1 + 1e-6), output_type="ndarray")
        clear = self._coverage.are_clear(points[pairs[:, 0]], points[pairs[:, 1]]) if len(pairs) else np.zeros(0, dtype=bool)
        return [(int(start), int(end)) for start, end in pairs[clear]]

    def _joints(self, points: Points, crossings: Crossings) -> Points:
        """Further points that join places which are near each other on the floor, as a crossing leads from what sees the one to what sees
        the other, but not on the roadmap."""
        is_near = self._near_each_other(points)
        apart = ~np.asarray(is_near[crossings.low, crossings.high]).ravel() if len(crossings.low) else np.zeros(0, dtype=bool)
        return self._far_from_each_other(np.stack([crossings.starts[apart], crossings.ends[apart]], axis=1))

    def _far_from_each_other(self, joints: Iterable[Points]) -> Points:
        """The joints without those near an earlier one: with that, they may not be needed."""
        chosen: list[Points] = []
        for joint in joints:
            if all(np.abs(joint - earlier).max() > self.spacing for earlier in chosen):
                chosen.append(joint)
        return np.vstack(chosen) if chosen else np.zeros((0, 2))

    def _near_each_other(self, points: Points) -> csr_array:
        """Which pairs of points are at most `HOPS` lanes apart."""
        pairs, size = np.array(self._pairs(points), dtype=int).reshape(-1, 2), len(points)
        matrix = coo_array((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(size, size)).tocsr()
        matrix = matrix + matrix.T + eye_array(size, dtype=bool, format="csr")
        for _ in range(round(math.log2(HOPS))):
            matrix = matrix @ matrix
        return matrix

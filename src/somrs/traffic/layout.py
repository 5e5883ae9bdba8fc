"""Roadmaps from the free space of a building.

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
from msgspec import Struct
from scipy import ndimage
from scipy.sparse import coo_array, csr_array, eye_array
from scipy.spatial import cKDTree

from somrs.ontology.map import Map
from somrs.ontology.objects import ValueSet
from somrs.ontology.types import Ontology
from somrs.space.free_space import FreeSpace
from somrs.space.shafts import SAME_FLOOR, Shaft, shafts_of
from somrs.space.solids import Point, Role, Solid, solid_of
from somrs.space.squares import Squares, box_around
from somrs.traffic.bays import find_bays
from somrs.traffic.coverage import UNSEEN, Coverage, Crossings, Points
from somrs.traffic.roadmap import Lane, Place, Roadmap, spacing_for

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
    """The space of a building with all doors open: of the floors at these heights, and of those to which lifts lead from there."""

    def __init__(self, map: Map, ontology: Ontology, levels: Iterable[float]) -> None:
        solids = [solid for object in map.objects.values() if (solid := solid_of(object, ontology)) is not None]
        self.shafts = [shaft for shaft in shafts_of(map, ontology) if shaft.landings]
        in_lifts = {door.name for shaft in self.shafts for landing in shaft.landings for door in landing.doors}
        self.doors = {solid.name: solid for solid in solids if solid.role is Role.DOOR and solid.name not in in_lifts}
        """Without those of lifts."""
        self.passages = [solid for solid in solids if ontology.is_subtype(solid.type, "Passage")]
        opened = map.changed([ValueSet(solid.name, "Open", True) for solid in solids if solid.role is Role.DOOR])
        self.spaces = {level: FreeSpace(opened, ontology, level=level) for level in connected_levels(levels, self.shafts)}
        """By height, the lowest first."""


class Layout(Struct, frozen=True, kw_only=True):
    """A roadmap is to be made of the floors at these heights, and of those to which lifts lead from there, for robots of these radii."""

    map: Map
    ontology: Ontology
    levels: tuple[float, ...]
    radii: tuple[float, ...]

    @property
    def building(self) -> OpenBuilding:
        return OpenBuilding(self.map, self.ontology, self.levels)


def lay_out(building: OpenBuilding, radii: Iterable[float]) -> Roadmap:
    """The roadmap for robots of these radii, in metres. Robots of about the same size share places; larger ones have places and lanes of
    their own."""
    parts = [_lay_out(building, radius, f"{layer}." if layer else "") for layer, radius in enumerate(sizes(radii))]
    places = (place for part in parts for place in part.places)
    doors = (replace(door, open=True) for door in building.doors.values() if door.automatic)
    return Roadmap(
        places=tuple(places),
        lanes=tuple(lane for part in parts for lane in part.lanes),
        lifts=tuple(shaft.name for shaft in building.shafts),
        doors=tuple(doors),
    )


def sizes(radii: Iterable[float]) -> list[float]:
    """The radii for which there are places of their own, the smallest first: each is the largest of some that are about the same."""
    classes: list[float] = []
    for radius in sorted(radii, reverse=True):
        if not classes or radius * SAME_SIZE < classes[-1]:
            classes.append(radius)
    return classes[::-1]


def _lay_out(building: OpenBuilding, radius: float, prefix: str) -> Roadmap:
    """The part of the roadmap for robots of at most this radius."""
    places: list[Place] = []
    lanes: list[Lane] = []
    stops: dict[str, list[Place]] = {}
    for number, (level, space) in enumerate(building.spaces.items()):
        passages = [(solid.x, solid.y) for solid in building.passages if abs(solid.z - level) < SAME_FLOOR]
        cabins = [shaft for shaft in building.shafts if shaft.landing(level) is not None]
        storey = _Storey(space, radius + MARGIN, spacing_for(radius))
        points, pairs = storey.lay_out([*((shaft.cabin.x, shaft.cabin.y) for shaft in cabins), *passages])
        zones = [_zone((x, y), level, radius, cabins) for x, y in points.tolist()]
        on_level = [
            Place(name=f"P{prefix}{number}/{index}", x=x, y=y, level=level, radius=radius, spacing=storey.spacing, zone=zone)
            for index, ((x, y), zone) in enumerate(zip(points.tolist(), zones, strict=True))
        ]
        places += on_level
        for first, second in pairs:
            seconds = max(math.dist(points[first], points[second]) / SPEED, 0.05)
            lanes += _both_ways(on_level[first], on_level[second], seconds)
        for shaft in cabins:
            inner = [place for place in on_level if place.zone == shaft.name and _can_ride(place, radius, shaft)]
            if inner:
                middle = shaft.cabin.x, shaft.cabin.y
                stops.setdefault(shaft.name, []).append(min(inner, key=lambda place: math.dist((place.x, place.y), middle)))
    for shaft in building.shafts:
        for start, end in combinations(stops.get(shaft.name, ()), 2):
            lanes += _both_ways(start, end, ride_seconds(shaft.cabin, start.level, end.level))
    return Roadmap(places=tuple(places), lanes=tuple(lanes))


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


def _both_ways(start: Place, end: Place, seconds: float) -> Iterator[Lane]:
    yield Lane(start=start.name, end=end.name, seconds=seconds)
    yield Lane(start=end.name, end=start.name, seconds=seconds)


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

    def lay_out(self, middles: Sequence[Point]) -> tuple[Points, list[tuple[int, int]]]:
        """The points, and the pairs of them that a straight lane joins. `middles`: those of cabins and passages."""
        points = self._spread([*filter(self._is_free, middles), *self._lattice()])
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

    def _spread(self, points: Sequence[Point]) -> Points:
        """The points without those that are nearer to an earlier one than half of the spacing."""
        kept: list[Point] = []
        least = self.spacing / 2
        squares = Squares[Point](least)
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

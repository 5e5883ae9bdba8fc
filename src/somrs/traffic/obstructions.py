"""What is in the way on a roadmap: which places and lanes a robot cannot use because of doors, lifts, and what stands there."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from somrs.space.clearance import Disc
from somrs.space.distances import distances_from
from somrs.space.free_space import SLACK, FreeSpace
from somrs.space.shafts import SAME_FLOOR
from somrs.space.solids import Role, Solid
from somrs.traffic.coverage import SAMPLES, Points
from somrs.traffic.layout import MARGIN
from somrs.traffic.notices import ClosedLane, ClosedPassage, CloseWays
from somrs.traffic.planning.graph import Lane
from somrs.traffic.roadmap import NumberedRoadmap
from somrs.traffic.state import Position

NO_NEARER = 0.005
"""How much nearer to something a robot may come before it counts as nearer, in metres."""

Numbers = NDArray[np.int64]
Room = Callable[[Points], NDArray[np.floating]]
"""The distance from each of the points (n, 2) to the nearest obstacle, in metres."""


@dataclass(frozen=True, slots=True)
class _Floor:
    """The places of a floor: their numbers, points, and the clearance that robots need there; and the lanes, by the rows of their ends."""

    numbers: Numbers
    points: Points
    need: NDArray[np.float64]
    lanes: Numbers


class Obstructions:
    """What is in the way on a roadmap."""

    def __init__(self, roadmap: NumberedRoadmap) -> None:
        self._roadmap = roadmap
        places = roadmap.roadmap.places
        self._floors = {level: self._floor(level) for level in sorted({place.level for place in places})}

    def _floor(self, level: float) -> _Floor:
        places, successors = self._roadmap.roadmap.places, self._roadmap.graph.successors
        numbers = [number for number, place in enumerate(places) if place.level == level]
        rows = {number: row for row, number in enumerate(numbers)}
        lanes = [(rows[start], rows[end]) for start in numbers for end in successors[start] if end in rows]
        return _Floor(
            numbers=np.array(numbers, dtype=int),
            points=np.array([(places[number].x, places[number].y) for number in numbers], dtype=float).reshape(-1, 2),
            need=np.array([places[number].radius + MARGIN - 1.2 * SLACK for number in numbers]),
            lanes=np.array(lanes, dtype=int).reshape(-1, 2),
        )

    @property
    def levels(self) -> tuple[float, ...]:
        """The heights of the floors, the lowest first."""
        return tuple(self._floors)

    def blocked(self, level: float, room: Room) -> tuple[list[int], list[Lane]]:
        """The places on a floor without enough room, and the lanes without it between other places."""
        floor = self._floors[level]
        return self._without_room(floor, room, floor.lanes, np.arange(len(floor.numbers)))

    def touching(self, solid: Solid) -> tuple[list[int], list[Lane]]:
        """The places at which a robot touches a door, and the lanes between other places on which it does."""
        places: list[int] = []
        lanes: list[Lane] = []
        for level, floor in self._floors.items():
            if abs(level - solid.z) < SAME_FLOOR:
                apart = np.hypot(floor.points[:, 0] - solid.x, floor.points[:, 1] - solid.y)
                is_near = apart < solid.extent + 2 * self._roadmap.widest
                near_lanes = floor.lanes[is_near[floor.lanes[:, 0]] & is_near[floor.lanes[:, 1]]]
                touched = self._without_room(floor, lambda points: distances_from(solid, points), near_lanes, np.flatnonzero(is_near))
                places += touched[0]
                lanes += touched[1]
        return places, lanes

    def into_zones(self, areas: Sequence[Solid]) -> list[list[Lane]]:
        """For each no-go zone: the lanes on which a robot would be in it, but for those by which one that is in some zone comes nearer to
        where it is out of all of them."""
        touched = [self.touching(area) for area in areas]
        steps = self._steps_to_edge({place for places, _ in touched for place in places})
        candidates = (dict.fromkeys((*lanes, *self._lanes_at(places))) for places, lanes in touched)
        return [[(start, end) for start, end in lanes if steps.get(start, 0) <= steps.get(end, 0)] for lanes in candidates]

    def _steps_to_edge(self, places: Collection[int]) -> dict[int, float]:
        """For each of some places: how many lanes lead to one that is none of them; infinite if none do."""
        successors, predecessors = self._roadmap.graph.successors, self._roadmap.graph.predecessors
        steps, edge = dict.fromkeys(places, math.inf), deque[int]()
        for place in places:
            if any(end not in steps for end in successors[place]):
                steps[place] = 1
                edge.append(place)
        while edge:
            place = edge.popleft()
            for inner in predecessors[place]:
                if steps.get(inner) == math.inf:
                    steps[inner] = steps[place] + 1
                    edge.append(inner)
        return steps

    def _lanes_at(self, places: Iterable[int]) -> Iterator[Lane]:
        """The lanes from and to places."""
        graph = self._roadmap.graph
        for place in places:
            yield from ((place, end) for end in graph.successors[place])
            yield from ((start, place) for start in graph.predecessors[place])

    def closing(
        self,
        free_spaces: Mapping[float, FreeSpace],
        standing: Mapping[float, Sequence[Disc]],
        out_of_order: Sequence[Solid] = (),
        forbidden: Sequence[Solid] = (),
        shut_lifts: Iterable[str] = (),
    ) -> CloseWays:
        """What is closed: by level, what the free space knows, and things on the floor; doors and lifts that are out of order; the ways
        into no-go zones; and lifts that nobody may enter for another reason. Levels without a free space have nothing closed: nobody
        drives there now."""
        places: list[int] = []
        lanes = [lane for lift in shut_lifts for lane in self.into_lift(lift)]
        for level in free_spaces.keys() & {*self.levels}:
            blocked = self.blocked(level, partial(_room, free_spaces[level], standing[level]))
            places += blocked[0]
            lanes += blocked[1]
        zones = (
            ClosedPassage(name=area.name, zone=True, lanes=self._closed_lanes(entering_lanes))
            for area, entering_lanes in zip(forbidden, self.into_zones(forbidden), strict=True)
        )
        passages = (*map(self._closed_passage, out_of_order), *zones)
        return CloseWays(places=self._names(places), lanes=self._closed_lanes(lanes), passages=passages)

    def _closed_passage(self, passage: Solid) -> ClosedPassage:
        """The places and lanes at which a robot would be in a door; or the lanes by which it would come into a lift, or ride in it."""
        is_lift = passage.role is Role.LIFT
        places, lanes = ([], [*self.into_lift(passage.name)]) if is_lift else self.touching(passage)
        return ClosedPassage(name=passage.name, places=self._names(places), lanes=self._closed_lanes(lanes))

    def _names(self, places: list[int]) -> tuple[str, ...]:
        return tuple(self._roadmap.names[place] for place in places)

    def _closed_lanes(self, lanes: list[Lane]) -> tuple[ClosedLane, ...]:
        return tuple(ClosedLane(start=self._roadmap.names[start], end=self._roadmap.names[end]) for start, end in lanes)

    def _without_room(self, floor: _Floor, room: Room, lanes: Numbers, rows: Numbers) -> tuple[list[int], list[Lane]]:
        """The places of these rows without enough room, and those of the lanes without it that do not end there.

        A robot that is at such a place leaves it by lanes on which it does not come nearer to what is there.
        """
        clearances = np.full(len(floor.numbers), math.inf)
        clearances[rows] = room(floor.points[rows])
        blocked = clearances < floor.need
        lanes = lanes[~blocked[lanes[:, 1]]]
        starts, ends = floor.points[lanes[:, 0]], floor.points[lanes[:, 1]]
        least_clearances = np.minimum(floor.need[lanes[:, 0]], clearances[lanes[:, 0]] - NO_NEARER)
        shut_lanes = lanes[least_room(room, starts, ends) < least_clearances]
        closed: list[int] = floor.numbers[blocked].tolist()
        return closed, [(start, end) for start, end in floor.numbers[shut_lanes].tolist()]

    def into_lift(self, lift: str) -> Iterator[Lane]:
        """The lanes by which a robot comes into a lift, or rides in it."""
        places = self._roadmap.roadmap.places
        for end in self._roadmap.zones.get(lift, ()):
            for start in self._roadmap.graph.predecessors[end]:
                if places[start].zone != lift or places[start].level != places[end].level:
                    yield start, end


def discs_along(positions: Sequence[Position]) -> Iterator[tuple[float, Disc]]:
    """The space of a robot that may be anywhere on its way, as discs, with the heights of their floors."""
    for start, end in pairwise(positions):
        steps = max(1, math.ceil(math.dist((start.x, start.y), (end.x, end.y)) / max(start.radius / 2, MARGIN)))
        for share in (step / steps for step in range(steps if start.level == end.level else 1)):
            yield start.level, Disc(start.x + (end.x - start.x) * share, start.y + (end.y - start.y) * share, start.radius)
    for last in positions[-1:]:
        yield last.level, Disc(last.x, last.y, last.radius)


def _room(free_space: FreeSpace, discs: Sequence[Disc], points: Points) -> NDArray[np.float64]:
    """The distance from each point to the nearest obstacle."""
    room = np.asarray(free_space.clearances(points), dtype=float)
    for disc in discs:
        room = np.minimum(room, np.hypot(points[:, 0] - disc.x, points[:, 1] - disc.y) - disc.radius)
    return room


def least_room(room: Room, starts: Points, ends: Points) -> NDArray[np.float64]:
    """The least room between the ends of each of the straight lines from starts (n, 2) to ends (n, 2), in metres."""
    least: NDArray[np.float64] = np.full(len(starts), math.inf)
    if len(starts):
        shares = np.linspace(0, 1, SAMPLES + 1)[1:-1, None, None]
        points = starts * (1 - shares) + ends * shares
        least = room(points.reshape(-1, 2)).reshape(SAMPLES - 1, -1).min(axis=0).astype(float)
    return least

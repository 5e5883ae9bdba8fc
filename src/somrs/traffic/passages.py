"""The lifts and automatic doors of a roadmap: which of them have to be open before a robot drives along a lane, and what is closed with
them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from somrs.space.doorways import DOOR_ROOM, doors_between
from somrs.space.shafts import SAME_FLOOR
from somrs.space.solids import Solid
from somrs.traffic.berths import Berths
from somrs.traffic.planning.graph import FAR, Lane
from somrs.traffic.state import OutOfOrder, Position


class Passages:
    """The passages of a roadmap that have programs. Places and berths are numbers, as in `Berths`."""

    def __init__(self, berths: Berths) -> None:
        self._berths, roadmap = berths, berths.roadmap.roadmap
        self._graph = berths.roadmap.graph
        self.lifts, self._doors = frozenset(roadmap.lifts), roadmap.doors
        self.names = (*roadmap.lifts, *(door.name for door in roadmap.doors))
        self._near_doors = self._doors_near_places() if roadmap.doors else {}
        self._touched: dict[Lane, frozenset[str]] = {}

    def may_be(self, name: str) -> bool:
        """Whether this is a passage. Before there is a roadmap, nobody knows."""
        return name in self.names or not self._graph.size

    def _doors_near_places(self) -> dict[int, list[Solid]]:
        """By place: the doors that the lanes from there may come near to."""
        places = self._berths.roadmap.roadmap.places
        lanes = ((places[start], places[end]) for start, ends in enumerate(self._graph.successors) for end in ends)
        longest = max((math.dist((a.x, a.y), (b.x, b.y)) for a, b in lanes), default=0.0)
        near: dict[int, list[Solid]] = {}
        for door in self._doors:
            for number, place in enumerate(places):
                reach = door.extent + longest + place.radius + DOOR_ROOM
                if abs(place.level - door.z) < SAME_FLOOR and math.dist((place.x, place.y), (door.x, door.y)) < reach:
                    near.setdefault(number, []).append(door)
        return near

    def touched(self, start: int, end: int) -> frozenset[str]:
        """The doors that a robot touches somewhere on a lane, or at a place where it stays."""
        is_place = start < self._graph.size and end < self._graph.size
        doors = self._near_doors.get(start, ()) if is_place else self._doors
        if not doors:
            return frozenset()
        if not is_place:
            return self._doors_along(doors, start, end)  # numbers of berths stand for other points later
        if (start, end) not in self._touched:
            self._touched[start, end] = self._doors_along(doors, start, end)
        return self._touched[start, end]

    def _doors_along(self, doors: Sequence[Solid], start: int, end: int) -> frozenset[str]:
        return frozenset(_doors_along(doors, self._berths.position(start), self._berths.position(end)))

    def doors_on(self, way: Sequence[int]) -> frozenset[str]:
        """The doors that a robot touches somewhere on its way."""
        lanes = [*pairwise(way), *((place, place) for place in way[-1:])]
        return frozenset[str]().union(*(self.touched(start, end) for start, end in lanes)) if self._doors else frozenset()

    def doors_along(self, way: Sequence[Position]) -> frozenset[str]:
        """The same for a robot that was on another roadmap."""
        points = [*pairwise(way), *((place, place) for place in way[-1:])]
        return frozenset(name for start, end in points for name in _doors_along(self._doors, start, end))

    def entered(self, start: int, end: int) -> tuple[str, ...]:
        """The passages that have to be open before a robot departs: the lift into or out of which a lane leads, or in which it is a ride;
        and the doors in which the robot is not yet."""
        lift = self.lift_of(start, end)
        doors = sorted(self.touched(start, end) - self.touched(start, start)) if self._doors else ()
        return (*((lift,) if lift is not None else ()), *doors)

    def gated(self, way: Sequence[int]) -> tuple[int, ...]:
        """Before which places of a way passages have to be open: their numbers on it, where 0 is where the robot is."""
        if not self.names:
            return ()
        return tuple(number for number, (start, end) in enumerate(pairwise(way), 1) if self.entered(start, end))

    def lift_of(self, start: int, end: int) -> str | None:
        """The lift through whose doors a lane leads, or in which it is a ride."""
        current, following = self._berths.position(start), self._berths.position(end)
        lift = current.zone if current.zone is not None else following.zone
        is_within = (current.zone, current.level) == (following.zone, following.level)
        return lift if lift in self.lifts and not is_within else None

    def lifts_on(self, way: Sequence[int]) -> set[str]:
        """The lifts of which a robot holds places."""
        return {zone for place in way if (zone := self._berths.position(place).zone) in self.lifts and zone is not None}

    def is_inside(self, place: int) -> bool:
        """Whether it is a place of a lift."""
        return self._berths.position(place).zone in self.lifts

    def level(self, lift: str, way: Sequence[int]) -> float:
        """The height of the floor at which a robot on its way needs the cabin now: where it enters; or, if it is in the lift, where its
        next lane leads."""
        start = way[0]
        if self._berths.position(start).zone == lift:
            end = way[1] if len(way) > 1 and self.lift_of(start, way[1]) == lift else start
        else:
            end = next(end for _, end in pairwise(way) if self._berths.position(end).zone == lift)
        return self._berths.position(end).level

    def destination(self, lift: str, robot: str, way: Sequence[int], goal: int | None) -> float | None:
        """The height of the floor on which a robot is to leave a lift, on the way that it has and the shortest one on to its goal."""
        graph, last = self._berths.graph, way[-1]
        planned = [*graph.way(last, goal, robot)] if goal is not None and graph.distance(last, goal) < FAR else []
        positions = [self._berths.position(place) for place in (*way, *planned)]
        first = next((number for number, position in enumerate(positions) if position.zone == lift), len(positions))
        exits = (position.level for position in positions[first:] if position.zone != lift)
        return next(exits, None)

    def closing(self, name: str) -> OutOfOrder:
        """The lanes by which a robot would come into a lift, or ride in it; or the places and lanes on which it would be in a door."""
        successors = self._graph.successors
        lanes = [(start, end) for start in range(self._graph.size) for end in successors[start]]
        if name in self.lifts:
            zones = [place.zone for place in self._berths.roadmap.roadmap.places]
            return OutOfOrder(name, (), tuple(lane for lane in lanes if zones[lane[1]] == name and self.lift_of(*lane) == name))
        places = {place for place in self._near_doors if name in self.touched(place, place)}
        shut_lanes = (lane for lane in lanes if name in self.touched(*lane) and places.isdisjoint(lane))
        return OutOfOrder(name, tuple(sorted(places)), tuple(shut_lanes))


def _doors_along(doors: Sequence[Solid], start: Position, end: Position) -> Iterator[str]:
    if start.level == end.level:
        yield from doors_between(doors, start.level, (start.x, start.y), (end.x, end.y), start.radius)

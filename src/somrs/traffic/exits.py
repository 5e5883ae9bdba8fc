"""The ways out of zones, such as the cabins of lifts: while traffic is held, no robot is to stand there."""

from __future__ import annotations

from collections.abc import Iterator
from heapq import heappop, heappush

from somrs.traffic.berths import Berths
from somrs.traffic.schedule import Schedule


class Exits:
    """Finds where robots leave the zones in which their granted ways end."""

    def __init__(self, schedule: Schedule, berths: Berths) -> None:
        self._schedule, self._berths = schedule, berths

    def nearest(self, robot: str) -> int | None:
        """The nearest place outside, on the same floor, and if possible one that no other robot holds.

        None if the way of the robot does not end in a zone, or if no way leads out.
        """
        start = self._schedule.last(robot)
        if not self._is_inside(start):
            return None
        exits = [*self._outside(start)]
        free_exits = (place for place in exits if self._schedule.holder(place, besides=robot) is None)
        return next(free_exits, exits[0] if exits else None)

    def _outside(self, start: int) -> Iterator[int]:
        """The places next to the zone, the nearest first."""
        graph, level = self._berths.graph, self._level(start)
        waiting, reached = [(0.0, start)], set[int]()
        while waiting:
            distance, place = heappop(waiting)
            if place in reached:
                continue
            reached.add(place)
            if not self._is_inside(place):
                yield place
                continue
            for following in graph.successors[place]:
                if self._level(following) == level:
                    heappush(waiting, (distance + graph.length(place, following), following))

    def _is_inside(self, number: int) -> bool:
        """Whether a place is in a zone, or a berth beside places of zones only."""
        places, size = self._berths.roadmap.roadmap.places, self._berths.roadmap.graph.size
        if number < size:
            return places[number].zone is not None
        entry = self._berths.slots[number - size]
        return entry is not None and all(places[neighbour].zone is not None for neighbour, _ in entry.lanes)

    def _level(self, number: int) -> float:
        places, size = self._berths.roadmap.roadmap.places, self._berths.roadmap.graph.size
        if number < size:
            return places[number].level
        entry = self._berths.slots[number - size]
        assert entry is not None, "only those in use have a number"
        return entry.level

"""Where robots go that are not to stay where their way ends: out of zones, such as the cabins of lifts, while traffic is held; and on from
waypoints at which robots are not to stop, when they have nothing to do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
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
        return self._nearest(robot, self._is_inside)

    def rest(self, robot: str) -> int | None:
        """The nearest place on from where robots are not to stop, on the same floor, and if possible one that no other robot holds.

        None if the way of the robot ends elsewhere, or if no way leads on.
        """
        return self._nearest(robot, self._is_passed) if self._berths.roadmap.passthrough else None

    def _nearest(self, robot: str, is_left: Callable[[int], bool]) -> int | None:
        start = self._schedule.last(robot)
        if not is_left(start):
            return None
        exits = [*self._outside(start, is_left)]
        free_exits = (place for place in exits if self._schedule.holder(place, besides=robot) is None)
        return next(free_exits, exits[0] if exits else None)

    def _outside(self, start: int, is_left: Callable[[int], bool]) -> Iterator[int]:
        """The first places that are not to be left, the nearest first."""
        graph, level = self._berths.graph, self._level(start)
        waiting, reached = [(0.0, start)], set[int]()
        while waiting:
            distance, place = heappop(waiting)
            if place in reached:
                continue
            reached.add(place)
            if not is_left(place):
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

    def _is_passed(self, number: int) -> bool:
        """Whether robots are not to stop at a place, or it is too near to such a one."""
        return not self._berths.roadmap.passthrough.isdisjoint((number, *self._berths.graph.exclusions[number]))

    def _level(self, number: int) -> float:
        places, size = self._berths.roadmap.roadmap.places, self._berths.roadmap.graph.size
        if number < size:
            return places[number].level
        entry = self._berths.slots[number - size]
        assert entry is not None, "only those in use have a number"
        return entry.level

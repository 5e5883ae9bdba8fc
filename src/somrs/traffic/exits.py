"""Where robots go that are not to stay where their way ends: out of zones, such as the cabins of lifts, while traffic is held; and, when
they have nothing to do, on from waypoints at which robots are not to stop, and away from robots that have got stuck between two places."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from heapq import heappop, heappush

from somrs.protocol.messages.traffic import Mobility
from somrs.space.lines import point_distance
from somrs.traffic.berths import Berths
from somrs.traffic.roadmap import GAP, least_distance, spacing_for
from somrs.traffic.schedule import Schedule
from somrs.traffic.state import Position, TrafficState

Lane = tuple[Position, Position]


class Exits:
    """Finds where robots leave the zones in which their granted ways end."""

    def __init__(self, state: TrafficState, schedule: Schedule, berths: Berths) -> None:
        self._state, self._schedule, self._berths = state, schedule, berths

    def nearest(self, robot: str) -> int | None:
        """The nearest place outside, on the same floor, and if possible one that no other robot holds.

        None if the way of the robot does not end in a zone, or if no way leads out.
        """
        return self._nearest(robot, self._is_inside)

    def rest(self, robot: str, stuck: Mapping[str, Lane]) -> int | None:
        """The nearest place on from where robots are not to stop, on the same floor, and if possible one that no other robot holds.

        They are not to stop at waypoints to pass, nor where they keep a robot that is stuck between two places from saying exactly where it
        is: others come nearer to it then. None if the way of the robot ends elsewhere, or if no way leads on.

        `stuck`: the `stuck_lanes`.
        """
        lanes = [lane for name, lane in stuck.items() if name != robot]
        if not lanes and not self._berths.roadmap.passthrough:
            return None
        return self._nearest(robot, lambda place: self._is_passed(place) or any(self._is_beside(place, *lane) for lane in lanes))

    def stuck_lanes(self) -> dict[str, Lane]:
        """The lanes on which robots are that cannot move, and say so."""
        position = self._berths.position
        return {
            name: (position(held[0]), position(held[1]))
            for name, record in self._state.robots.items()
            if record.mobility is Mobility.IMMOBILE and not record.silent and len(held := self._schedule.held(name)) > 1
        }

    def _is_beside(self, number: int, start: Position, end: Position) -> bool:
        """Whether a robot at a place may be too near to one that says it stands somewhere on a lane."""
        position = self._berths.position(number)
        least = least_distance(spacing_for(position.radius), spacing_for(start.radius)) + GAP
        distance = point_distance((position.x, position.y), (start.x, start.y), (end.x, end.y))
        return position.level == start.level == end.level and distance < least

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

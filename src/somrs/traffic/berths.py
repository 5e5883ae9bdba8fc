"""Berths: points beside the roadmap at which robots stand, each of them a place for one robot alone, as long as it is used."""

from __future__ import annotations

import math
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from itertools import pairwise

from somrs.errors import UsageError
from somrs.protocol.messages.traffic import Berth
from somrs.traffic.planning.graph import FAR, Graph, PrivatePlace
from somrs.traffic.roadmap import NumberedRoadmap, UsedBerth
from somrs.traffic.state import Closed, OutOfOrder, PlannedBerth, Position
from somrs.traffic.surroundings import TOLERANCE, Surroundings, zone_of

SPEED = 0.5
"""The speed at which robots are taken to drive to their berths, in metres per second."""
SHORTEST = 0.1
"""The least time that a lane to a berth takes, in seconds."""


class Berths:
    """The berths on a roadmap that are in use. `slots` is the data of a component's state: the number of the first is the first after those
    of the places."""

    def __init__(self, roadmap: NumberedRoadmap, slots: list[UsedBerth | None], closed: Closed = Closed()) -> None:
        self.roadmap, self.slots, self._closed = roadmap, slots, closed
        self.private_places: list[PlannedBerth | None] = []
        """By slot: the berth for the planner."""
        self._graph_places: list[PrivatePlace | None] = []
        """By slot: the same, for the graph of this."""
        self._surroundings = Surroundings(roadmap)
        self._slots_by_name: dict[tuple[str, str], int] = {}
        """By robot and name of the berth."""
        for slot, entry in enumerate(slots):
            if entry is not None:
                self._surroundings.put(slot, entry)
                self._slots_by_name[entry.robot, entry.berth.name] = slot
        self.graph = self._changed_graph(range(len(slots)))

    def number(self, place: str, robot: str) -> int:
        """The number of a place or of a berth of this robot. Raises UsageError."""
        slot = self._slot(robot, place)
        return self.roadmap.graph.size + slot if slot is not None else self.roadmap.number(place)

    def has(self, name: str, robot: str) -> bool:
        """Whether a berth of this robot has the name."""
        return self._slot(robot, name) is not None

    def name(self, number: int) -> str:
        """The name of the place or berth of this number."""
        if number < self.roadmap.graph.size:
            return self.roadmap.names[number]
        entry = self.slots[number - self.roadmap.graph.size]
        assert entry is not None, "only those in use have a number"
        return entry.berth.name

    def are_joined(self, place: int, towards: int) -> bool:
        """Whether a lane leads from one place or berth to another, or back: a robot turns round where something is in its way. A robot may
        be on one that is closed by now."""
        first = self.roadmap.graph.size
        if max(place, towards) < first:
            return self.roadmap.graph.is_lane(place, towards) or self.roadmap.graph.is_lane(towards, place)
        berth, end = max(place, towards), min(place, towards)
        entry = self.slots[berth - first]
        return entry is not None and any(start == end for start, _ in entry.lanes)

    def position(self, number: int) -> Position:
        """Where the place or berth of this number is."""
        if number < self.roadmap.graph.size:
            place = self.roadmap.roadmap.places[number]
            return Position(x=place.x, y=place.y, level=place.level, radius=place.radius, zone=place.zone)
        entry = self.slots[number - self.roadmap.graph.size]
        assert entry is not None, "only those in use have a number"
        return Position(x=entry.berth.x, y=entry.berth.y, level=entry.level, radius=entry.berth.radius, zone=zone_of(self.roadmap, entry))

    def add(self, robot: str, berth: Berth) -> None:
        """Use a berth. Raises UsageError for one that cannot be used."""
        entry, known = self._use(robot, berth), self._slot(robot, berth.name)
        if known is not None:
            if self.slots[known] != entry:  # the robot may stand there, or others may rely on it
                raise UsageError(f"{berth.name} is in use for another point: give each berth a name of its own")
            return
        slot = self.slots.index(None) if None in self.slots else len(self.slots)
        self.slots[slot : slot + 1] = [entry]
        self._slots_by_name[robot, berth.name] = slot
        self.graph = self._changed_graph(sorted(self._surroundings.put(slot, entry)))

    def _slot(self, robot: str, name: str) -> int | None:
        """Where a berth of this robot is in `slots`."""
        return self._slots_by_name.get((robot, name))

    def close(self, closed: Closed) -> None:
        """These places and lanes are closed from now on, and all others are open."""
        self._closed = closed
        self.graph = self._changed_graph(range(len(self.slots)))

    def closed_passages(self, robot: str, start: int, destination: int) -> tuple[OutOfOrder, ...]:
        """The passages that are out of order, and the no-go zones, on the shortest way that there would be with them."""
        passages = self._closed.passages
        if not passages:
            return ()
        graph = with_berths(self.roadmap.graph, Closed(self._closed.places, self._closed.lanes), self.private_places)
        way = [*graph.way(start, destination, robot)]
        lanes = {*pairwise((start, *way))}
        return tuple(passage for passage in passages if not (lanes.isdisjoint(passage.lanes) and {*way}.isdisjoint(passage.places)))

    def is_shut(self, start: int, destination: int) -> bool:
        """Whether there would be a way if nothing stood there, all doors were open, and nothing were out of order."""
        graph = with_berths(self.roadmap.graph, Closed(), self.private_places)
        return graph.distances(destination)[start] < FAR

    def keep(self, numbers: Collection[int]) -> bool:
        """Use only the berths of these numbers any more. Returns whether there were others."""
        first = self.roadmap.graph.size
        unused_slots = [slot for slot, entry in enumerate(self.slots) if entry is not None and first + slot not in numbers]
        changed_slots = {*unused_slots}
        self._slots_by_name = {key: slot for key, slot in self._slots_by_name.items() if slot not in changed_slots}
        for slot in unused_slots:
            self.slots[slot] = None
            changed_slots |= self._surroundings.remove(slot)
        while self.slots and self.slots[-1] is None:
            self.slots.pop()
        if unused_slots:
            self.graph = self._changed_graph(sorted(changed_slots))
        return bool(unused_slots)

    def _use(self, robot: str, berth: Berth) -> UsedBerth:
        if not berth.name.startswith(f"{robot}/"):
            raise UsageError(f"the berth {berth.name} is not one of {robot}: its name has to begin with {robot}/")
        if berth.name in self.roadmap.numbers:
            raise UsageError(f"the berth {berth.name} has the name of a place of the roadmap: give it another one")
        if not (all(map(math.isfinite, (berth.x, berth.y, berth.radius))) and berth.radius > 0):
            raise UsageError(
                f"{berth.name} is at ({berth.x}, {berth.y}), for a robot of radius {berth.radius}: numbers in metres are needed"
            )
        numbers = [self.roadmap.number(place) for place in dict.fromkeys(berth.places)]
        if not numbers:
            raise UsageError(f"{berth.name} needs a place of the roadmap from which {robot} drives there")
        places, spacing = [self.roadmap.roadmap.places[number] for number in numbers], self.roadmap.spacing(numbers[0])
        distances = [math.dist((place.x, place.y), (berth.x, berth.y)) for place in places]
        for place, distance in zip(places, distances, strict=True):
            if spacing and distance > spacing + TOLERANCE:
                raise UsageError(f"{berth.name} is {distance:.2f} m away from {place.name}: the spacing of {spacing:.2f} m is the most")
            if place.level != places[0].level:
                raise UsageError(f"{berth.name}: {place.name} is on another level than {places[0].name}")
            if place.kind != places[0].kind:
                raise UsageError(f"{berth.name}: {place.name} is for robots of another size, or on other lanes, than {places[0].name}")
        lanes = tuple((number, max(distance / SPEED, SHORTEST)) for number, distance in zip(numbers, distances, strict=True))
        return UsedBerth(robot=robot, berth=berth, level=places[0].level, lanes=lanes)

    def _changed_graph(self, slots: Iterable[int]) -> Graph:
        """The graph after the surroundings of the berths in these slots, or what is closed, have changed."""
        closed = self._closed.all_places
        for slot in slots:
            entry = self.slots[slot] if slot < len(self.slots) else None
            lanes = tuple(lane for lane in entry.lanes if lane[0] not in closed) if entry is not None else ()
            planned = PlannedBerth(entry.robot, lanes, self._surroundings.exclusions(slot)) if entry is not None else None
            self.private_places[slot : slot + 1] = [planned]
            self._graph_places[slot : slot + 1] = [_private_place(planned)]
        del self.private_places[len(self.slots) :], self._graph_places[len(self.slots) :]
        return _without_closed(self.roadmap.graph, self._closed).with_private(self._graph_places)


def with_berths(graph: Graph, closed: Closed, berths: Sequence[PlannedBerth | None], owners: Mapping[str, Hashable] | None = None) -> Graph:
    """The graph without the lanes to closed places, and with berths. `owners`: what stands for each robot in it; by default its name."""
    return _without_closed(graph, closed).with_private([_private_place(berth, owners) for berth in berths])


def _private_place(berth: PlannedBerth | None, owners: Mapping[str, Hashable] | None = None) -> PrivatePlace | None:
    if berth is None:
        return None
    return PrivatePlace(owners[berth.robot] if owners is not None else berth.robot, berth.lanes, berth.exclusions)


def _without_closed(graph: Graph, closed: Closed) -> Graph:
    places, lanes = closed.all_places, closed.all_lanes
    return graph.without_lanes_to(places, lanes) if places or lanes else graph

"""What robots keep others away from while they stand at their berths. As berths come and go all the time, it is found for each once."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from somrs.space.lines import point_distance
from somrs.traffic.roadmap import ROUNDING, NumberedRoadmap, UsedBerth, least_distance

GAP = 0.04
"""The least distance between robots at two berths, in metres. They keep half of it between them, as those of the simulator do, and each may
stand a quarter of it away from its berth."""

TOLERANCE = 1e-6
"""The error of computed distances, in metres."""

UNUSED = (math.inf, math.inf, 0.0)


class Surroundings:
    """The berths by the numbers of their slots, and what is too near to each of them."""

    def __init__(self, roadmap: NumberedRoadmap) -> None:
        self._roadmap = roadmap
        self._entries: dict[int, UsedBerth] = {}
        self._circles: list[tuple[float, float, float]] = []
        """By slot: x, y and radius."""
        self._places: dict[int, tuple[int, ...]] = {}
        """By slot: the places at which another robot would be too near."""
        self._near: dict[int, dict[int, tuple[int, ...]]] = {}
        """By slot, and by the slot of a berth near there: this if it is too near, or the places from which that goes past here."""

    def put(self, slot: int, entry: UsedBerth) -> set[int]:
        """Add a berth. Returns the slots whose surroundings change."""
        self._circles += [UNUSED] * (slot + 1 - len(self._circles))
        near_slots = self._may_be_near(entry)
        self._entries[slot], self._places[slot] = entry, tuple(self._near_places(entry))
        self._circles[slot] = entry.berth.x, entry.berth.y, entry.berth.radius
        self._near[slot] = {near: tuple(self._near_berth(entry, near)) for near in near_slots}
        for near in near_slots:
            self._near[near][slot] = tuple(self._near_berth(self._entries[near], slot))
        return {slot, *near_slots}

    def remove(self, slot: int) -> set[int]:
        """Remove a berth. Returns the slots whose surroundings change."""
        del self._entries[slot], self._places[slot]
        self._circles[slot] = UNUSED
        changed_slots = {*self._near.pop(slot)}
        for near in changed_slots:
            del self._near[near][slot]
        return changed_slots

    def exclusions(self, slot: int) -> tuple[int, ...]:
        """The places and berths at which another robot would be too near to the berth."""
        near = self._near[slot]
        return tuple(dict.fromkeys([*self._places[slot], *(number for other in sorted(near) for number in near[other])]))

    def _near_places(self, entry: UsedBerth) -> Iterator[int]:
        """The places at which another robot would be too near."""
        point, spacing = (entry.berth.x, entry.berth.y), self._roadmap.spacing(entry.lanes[0][0])
        for number in self._roadmap.near(point, entry.level):
            place = self._roadmap.roadmap.places[number]
            if math.dist((place.x, place.y), point) < least_distance(spacing, self._roadmap.spacing(number)) * (1 - ROUNDING):
                yield number
        zone = zone_of(self._roadmap, entry)
        if zone is not None:
            yield from self._roadmap.zones[zone]

    def _may_be_near(self, entry: UsedBerth) -> list[int]:
        """The slots of berths to which another robot may drive past this one: no lane to a berth is longer than the spacing."""
        if not self._roadmap.widest:
            return [*self._entries]
        x, y, radius = np.array(self._circles).reshape(-1, 3).T
        span = radius + (entry.berth.radius + GAP + self._roadmap.widest + TOLERANCE)
        slots: list[int] = np.flatnonzero(np.hypot(x - entry.berth.x, y - entry.berth.y) < span).tolist()
        return slots

    def _near_berth(self, entry: UsedBerth, slot: int) -> Iterator[int]:
        """The berth of another robot if it is too near; otherwise the places through which that drives there past this one. A robot holds
        its berth all the way to there, and back: while one that is too near is kept free, the places before it need not be."""
        near = self._entries[slot]
        if near.robot == entry.robot or near.level != entry.level:
            return
        point = entry.berth.x, entry.berth.y
        room, end = entry.berth.radius + near.berth.radius + GAP, (near.berth.x, near.berth.y)
        if math.dist(point, end) < room:
            yield self._roadmap.graph.size + slot
            return
        for start, _ in near.lanes:
            place = self._roadmap.roadmap.places[start]
            if point_distance(point, (place.x, place.y), end) < room:
                yield start


def zone_of(roadmap: NumberedRoadmap, entry: UsedBerth) -> str | None:
    """The zone in which a robot stands at a berth: that of the nearest place from which it drives there."""
    nearest, _ = min(entry.lanes, key=lambda lane: lane[1])
    return roadmap.roadmap.places[nearest].zone

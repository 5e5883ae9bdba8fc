"""The sessions of automatic doors: a door is open for the robots whose granted ways lead through it, simulated or not.

The lease is the session. A robot holds the places of its way from when they are granted until it has left them.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

from somrs.devices.simulator.motion.robot import AutomaticDoor
from somrs.space.doorways import doors_between
from somrs.traffic.component import Traffic


class AutomaticDoors:
    """Tells the doors, by name, whether robots need them."""

    def __init__(self, doors: Mapping[str, AutomaticDoor]) -> None:
        self._doors = doors
        self._needed: dict[str, tuple[object, frozenset[str]]] = {}
        """The doors that each robot needs, with what they follow from."""

    def advance(self, traffic: Traffic) -> None:
        """Call it once per control period."""
        if not self._doors:
            return
        needed: dict[str, tuple[object, frozenset[str]]] = {}
        for robot, held in traffic.state.held.items():
            ground = traffic.state.edition, tuple(held), len(self._doors)
            known = self._needed.get(robot)
            needed[robot] = known if known is not None and known[0] == ground else (ground, self._doors_of(traffic, robot))
        self._needed = needed
        open_doors = frozenset[str]().union(*(doors for _, doors in needed.values()))
        for name, door in self._doors.items():
            door.need(name in open_doors)

    def _doors_of(self, traffic: Traffic, robot: str) -> frozenset[str]:
        positions = traffic.positions(robot)
        solids = [door.solid for door in self._doors.values()]
        lines = [*pairwise(positions), *((last, last) for last in positions[-1:])]
        return frozenset(
            name
            for start, end in lines
            if start.level == end.level
            for name in doors_between(solids, start.level, (start.x, start.y), (end.x, end.y), start.radius)
        )

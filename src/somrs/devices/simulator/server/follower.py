"""Keeps a simulated world in agreement with the Repository's map.

The world is built from the map. It follows objects that are added, removed or renamed, changes of their types, and doors that open or
close. Positions come from the physics alone: positions that robots report to the map do not move objects.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable

from somrs.devices.simulator.server.simulation import Simulation
from somrs.kernel.component import Effect, Input, Started
from somrs.kernel.replica import Replica
from somrs.ontology.naming import Renaming, Section
from somrs.ontology.objects import Change, Map, ObjectAdded, ObjectRemoved, ValueSet, differences


class Follower:
    """A component that only receives. `simulation` is set when the event `read` is set: when the map has been read."""

    def __init__(self, address: str, repository: str) -> None:
        self.replica = Replica(address, repository)
        self.read = asyncio.Event()
        self.simulation: Simulation | None = None
        self._map = Map()

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Started):
            return self.replica.start(now)
        news = self.replica.handle(event, now)
        if news is None:
            return []
        map_before, self._map = self._map, self.replica.map
        if self.simulation is None and self.replica.ready:
            self.simulation = Simulation(self.replica.map, self.replica.ontology)
            self.read.set()
        elif self.simulation is not None:
            if news.ontology_changed:
                self.simulation.learn(self.replica.ontology)
            # A reloaded map has no list of changes, so they are computed from the difference.
            changes = differences(map_before, self.replica.map) if news.reloaded else news.changes
            renamed = [renaming for renaming in news.renamed if renaming.section is Section.OBJECTS] if not news.reloaded else []
            self._follow(self.simulation, changes, renamed)
        return news.effects

    def _follow(self, simulation: Simulation, changes: Iterable[Change], renamed: list[Renaming]) -> None:
        for change in changes:
            match change:
                case ObjectAdded(object) if renamed and renamed[0].to == object.name:
                    simulation.rename(renamed.pop(0).name, object)
                case ObjectAdded(object):
                    simulation.add(object)
                case ObjectRemoved(name) if renamed and renamed[0].name == name:
                    pass  # the next addition is the renamed object
                case ObjectRemoved(name):
                    simulation.remove(name)
                case ValueSet(name, "Open") if (door := self.replica.map.objects.get(name)) is not None:
                    simulation.renew(door)

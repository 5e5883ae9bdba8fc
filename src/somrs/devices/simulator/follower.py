"""Keeps a simulated world in step with the Repository: it is built from the map, what is added to the map appears in it, and doors
open and close as the map says. Where things are, the physics decides: what robots measure does not move them.
"""

from __future__ import annotations

import asyncio

from somrs.devices.simulator.simulation import Simulation
from somrs.ontology.objects import ObjectAdded, ObjectRemoved, ValueSet
from somrs.protocol.component import Effect, Input, Started
from somrs.protocol.replica import Replica


class Follower:
    """A component that only listens. `simulation` is there once the map was `read`."""

    def __init__(self, address: str, repository: str) -> None:
        self.replica = Replica(address, repository)
        self.read = asyncio.Event()
        self.simulation: Simulation | None = None

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Started):
            return self.replica.start(now)
        news = self.replica.handle(event, now)
        if news is None:
            return []
        if self.simulation is None and self.replica.ready:
            self.simulation = Simulation(self.replica.map, self.replica.ontology)
            self.read.set()
        elif self.simulation is not None:
            if news.definitions:
                self.simulation.learn(self.replica.ontology)
            for change in news.changes:
                match change:
                    case ObjectAdded(object):
                        self.simulation.add(object)
                    case ObjectRemoved(name):
                        self.simulation.remove(name)
                    case ValueSet(name, "Open") if (door := self.replica.map.objects.get(name)) is not None:
                        self.simulation.renew(door)
        return news.effects

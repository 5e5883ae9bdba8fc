"""Keeps a simulated world in step with the Repository: it is built from the map, and what is added to the map appears in it."""

from __future__ import annotations

import asyncio

from somrs.devices.simulator.simulation import Simulation
from somrs.ontology.objects import ObjectAdded, ObjectRemoved
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
        return news.effects

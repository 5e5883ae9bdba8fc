"""A simulated device in its world, driven by its driver alone: no Task Manager, no Service Manager."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from somrs.devices.simulator.drivers.simulated import SimulatedDevice
from somrs.devices.simulator.link.link import OperatorLink
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.repository.component import Repository
from somrs.service_manager.sdk.map_reader import MapReader
from somrs.service_manager.sdk.orders import Advance, Order, Perform, Quote, Quoted, Undo, WorkDone
from tests.support.robot_lab import map_after, repository, run_work, simulator
from tests.support.virtual_devices import make_ask


@dataclass
class SimulatedDeviceHarness:
    """`site`: the map as YAML, as it was at first; `advances`: the progress that the device has told."""

    device: SimulatedDevice
    operator: OperatorLink
    repository: Repository
    site: str
    advances: list[Advance] = field(default_factory=list)

    def order(self, service: str, **inputs: str) -> Order:
        service_type = upper().services[service]
        method = next(name for name, offered in self.device.services().items() if offered.type == service)
        return Order(participant="p", method=method, inputs=inputs, effect=service_type.effect, precondition=service_type.precondition)

    async def quote(self, service: str, **inputs: str) -> Quoted:
        quoted = await run_work(self.device, Quote(self.order(service, **inputs)), self.repository, self.advances)
        assert isinstance(quoted, Quoted)
        return quoted

    async def perform(self, service: str, **inputs: str) -> Map:
        """The map after the service, as it reports."""
        return await self._map_after(Perform(self.order(service, **inputs)))

    async def undo(self, service: str, situation: str, **inputs: str) -> Map:
        """The map after the service is undone, as it reports."""
        return await self._map_after(Undo(self.order(service, **inputs), situation))

    async def _map_after(self, work: Perform | Undo) -> Map:
        done = await run_work(self.device, work, self.repository, self.advances)
        assert isinstance(done, WorkDone)
        return map_after(done.situation, self.site)


@asynccontextmanager
async def simulated(kind: type[SimulatedDevice], name: str, site: str, speed: float | None = None) -> AsyncIterator[SimulatedDeviceHarness]:
    """Run a simulator of the site, and a device of this kind linked to it."""
    async with simulator(speed, site) as server, OperatorLink(server.host, server.port) as operator:
        knowledge = repository(site)
        device = kind(name, f"{server.host}:{server.port}")
        device.map = MapReader(make_ask(knowledge, lambda: 0.0))
        try:
            await device.open()
            yield SimulatedDeviceHarness(device, operator, knowledge, site)
        finally:
            await device.close()

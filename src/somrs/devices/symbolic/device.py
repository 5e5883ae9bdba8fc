"""The driver of a device in a symbolic world: it offers the services of the device's type; the world computes their results."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from somrs.devices.symbolic.lines import Apply, Begin, Estimate, Estimated, Hello, Look, Result, Welcome
from somrs.devices.symbolic.link import ask
from somrs.errors import DeviceError
from somrs.service_manager.sdk.device import Device, Service, Situation, Task
from somrs.service_manager.sdk.orders import Profile, ServiceFailed


class SymbolicDevice(Device):
    """Any device of a symbolic world. Its services are those of the world's ontology that its type can provide."""

    type = "Device"

    def __init__(self, name: str, simulator: str | None = None) -> None:
        super().__init__(name, simulator)
        self._kind = ""
        self._services: dict[str, Service] = {}

    async def open(self) -> None:
        welcome = await ask(self.simulator, Hello(device=self.name), Welcome)
        self._kind = welcome.type
        self._services = {name: _service(name) for name in welcome.services}
        if not self._services:
            raise DeviceError(f"no service type has a {welcome.type} as its provider, so {self.name} offers no services")

    def services(self) -> Mapping[str, Service]:
        return self._services

    def profile(self) -> Profile:
        """The profile. Before `open`, only the name is known."""
        capabilities = tuple(service.capability({}) for service in self._services.values())
        return Profile(name=self.name, type=self._kind or "Device", capabilities=capabilities)

    async def cost(self, task: Task) -> float:
        return (await self._estimated(task)).cost

    async def seconds(self, task: Task) -> float:
        return (await self._estimated(task)).seconds

    async def perform(self, task: Task) -> Situation:
        """Perform the service. Its effect holds in the world when its time is over, not before."""
        service, inputs = task.order.method, task.order.inputs
        estimated = await self._estimated(task)
        self._require_success(await ask(self.simulator, Begin(device=self.name, service=service, inputs=inputs), Result))
        await asyncio.sleep(estimated.seconds)
        return self._require_success(await ask(self.simulator, Apply(device=self.name, service=service, inputs=inputs), Result))

    async def halt(self, task: Task) -> Situation:
        return (await ask(self.simulator, Look(device=self.name, service=task.order.method, inputs=task.order.inputs), Result)).situation

    async def _estimated(self, task: Task) -> Estimated:
        return await ask(self.simulator, Estimate(device=self.name, service=task.order.method, inputs=task.order.inputs), Estimated)

    def _require_success(self, result: Result) -> str:
        if result.refusal is not None:
            raise ServiceFailed(f"{self.name} cannot: {result.refusal}", result.situation)
        return result.situation


def _service(name: str) -> Service:
    service = Service(SymbolicDevice.perform, name, SymbolicDevice.cost, SymbolicDevice.seconds, None)
    service.name = name  # the order's method then identifies the service
    service.stops = SymbolicDevice.halt
    return service

"""The adapter for VDA 5050 with a fleet that only notes which devices are added."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Mapping
from pathlib import Path
from typing import Any

from somrs.adapters.vda5050.adapter import Vda5050Adapter
from somrs.adapters.vda5050.control.exchange import Effect, Follow
from somrs.adapters.vda5050.robot import Vda5050Vehicle
from somrs.service_manager.sdk.device import Device
from tests.support.hang import HANG_TIME
from tests.support.vda5050_pair import way


class NotedFleet:
    """`devices`: those that were added. `effects`: what the state machine of each has found, by name."""

    data = Path(".somrs")

    def __init__(self) -> None:
        self.devices: dict[str, Vda5050Vehicle] = {}
        self.heights: dict[str, float] = {}
        """Of the storeys, m."""
        self.problems: dict[str, str | None] = {}
        self.effects: dict[str, list[Effect]] = {}

    def add(self, device: Device) -> None:
        assert isinstance(device, Vda5050Vehicle)
        self.devices[device.name] = device
        self.effects[device.name] = []
        device.session.on_effect = self.effects[device.name].append

    def report_problem(self, name: str, problem: str | None) -> None:
        self.problems[name] = problem

    async def remove(self, name: str) -> None:
        del self.devices[name]

    async def storeys(self) -> Mapping[str, float]:
        return self.heights

    def drive(self, name: str, *names: str, first: int = 0, spacing: float = 2.0) -> None:
        """Have a vehicle drive along a way, as of `way`."""
        self.devices[name].session.give(Follow(way=way(*names, first=first, spacing=spacing)))

    def has(self, name: str, effect: Effect) -> bool:
        return effect in self.effects.get(name, [])


@contextlib.asynccontextmanager
async def fleet_control(settings: dict[str, Any]) -> AsyncIterator[NotedFleet]:
    """Run the adapter."""
    fleet = NotedFleet()
    running = asyncio.create_task(Vda5050Adapter(settings, Path()).run(fleet))
    try:
        yield fleet
    finally:
        running.cancel()
        await asyncio.wait({running})


async def wait_until(condition: Callable[[], bool]) -> None:
    """Wait until something holds; fail when it takes as long as what hangs."""
    async with asyncio.timeout(HANG_TIME):
        while not condition():
            await asyncio.sleep(0.02)

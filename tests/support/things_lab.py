"""A small system with the adapter for things, in one process with real sockets."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from somrs.adapters.things.adapter import ThingsAdapter
from somrs.client.client import Client
from somrs.deployment.device import DeviceRunner
from somrs.errors import RemoteError
from somrs.service_manager.sdk.device import Device
from tests.support.hang import HANG_TIME
from tests.support.small_system import Porter, SmallSystem


class RunningFleet:
    """The devices of an adapter (somrs.adapters.adapter.Fleet) in this process, which join a small system."""

    def __init__(self, system: SmallSystem) -> None:
        self._system = system
        self.data = system.data
        self._runners: dict[str, DeviceRunner] = {}
        self._work: list[asyncio.Task[None]] = []
        self._turn = asyncio.Lock()
        self.reports: list[str] = []

    def add(self, device: Device) -> None:
        self._work.append(asyncio.create_task(self._start(device)))

    async def _start(self, device: Device) -> None:
        async with self._turn:
            if (runner := self._runners.pop(device.name, None)) is not None:
                await runner.stop()
            runner = self._runners[device.name] = DeviceRunner(device, self._system.addresses, self._system.data)
            await runner.start()

    def report_problem(self, name: str, problem: str | None) -> None:
        """Tell nobody."""

    async def remove(self, name: str) -> None:
        async with self._turn:
            await self._runners.pop(name).stop()

    async def storeys(self) -> Mapping[str, float]:
        raise NotImplementedError("things are where their mappings say")

    async def stop(self) -> None:
        await asyncio.gather(*self._work, return_exceptions=True)
        for runner in self._runners.values():
            await runner.stop()

    def failures(self) -> list[BaseException]:
        """Why devices did not start."""
        return [error for task in self._work if task.done() and (error := task.exception()) is not None]


class ThingsLab:
    """A system, and a client of it."""

    def __init__(self, system: SmallSystem, fleet: RunningFleet, client: Client) -> None:
        self.system, self.fleet, self.client = system, fleet, client

    async def holds(self, formula: str) -> bool:
        """Whether the map has it. It may have other names than the map has."""
        try:
            return bool((await self.client.query(formula, limit=1)).rows)
        except RemoteError:
            return False  # it is about what is not on the map yet

    async def until(self, formula: str) -> None:
        """Wait until the map has it."""

        async def wait() -> None:
            while not await self.holds(formula):
                assert not self.fleet.failures(), self.fleet.failures()
                await asyncio.sleep(0.02)

        await asyncio.wait_for(wait(), HANG_TIME)


@contextlib.asynccontextmanager
async def things_lab(folder: Path, settings: Mapping[str, Any], site: str = "", porters: Sequence[Porter] = ()) -> AsyncIterator[ThingsLab]:
    """A system with the adapter, which has these settings. `site`: the map; by default that of small systems."""
    system = SmallSystem(folder / "data", porters)
    if site:
        system.site = site
    await system.start()
    fleet = RunningFleet(system)
    adapter = asyncio.create_task(ThingsAdapter(settings, folder).run(fleet))
    try:
        async with Client(system.addresses) as client:
            lab = ThingsLab(system, fleet, client)
            yield lab
            assert not adapter.done() or adapter.exception() is None, adapter.exception()
    finally:
        await fleet.stop()
        adapter.cancel()
        await asyncio.gather(adapter, return_exceptions=True)
        await system.stop()

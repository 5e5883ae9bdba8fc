"""Several devices in one process: what happens to one does not happen to the others."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Callable
from functools import partial
from pathlib import Path

import pytest

from somrs.client.addresses import Addresses
from somrs.deployment import device_host
from somrs.deployment.device import device_journal
from somrs.deployment.device_host import HostedDevice, Listeners, make_device, name_device, parse_device
from somrs.errors import DeviceError
from somrs.ontology.types import PROBLEM, Value
from somrs.registry.component import Registry
from somrs.repository.component import Repository
from somrs.runtime.host import Host
from somrs.storage.journal import Journal
from tests.support.hang import HANG_TIME
from tests.support.lab import contents

DRIVERS = """
from pathlib import Path

from somrs.errors import DeviceError
from somrs.service_manager.sdk.device import Device, Situation, Task, service


class Carrier(Device):
    type = "PioneerP3DX"
    values = {"PositionX": 1, "PositionY": 1}

    @service("TransferObject", price="1 EUR", duration="1 s")
    async def transfer(self, task: Task) -> Situation:
        return None


class LateCarrier(Carrier):
    '''Its hardware is switched on later, by a file.'''

    async def open(self) -> None:
        if not (self.data / "on").exists():
            raise DeviceError("nothing answers at its port")


class FaultyCarrier(Carrier):
    async def open(self) -> None:
        raise ZeroDivisionError
"""


class Fleet:
    """Devices in this process, beside a Repository and a Registry. `devices`: the classes of `DRIVERS` by the devices' names."""

    def __init__(self, data: Path) -> None:
        self.data, self.devices = data, dict[str, HostedDevice]()
        self._running: list[asyncio.Task[None]] = []
        (data / "drivers.py").write_text(DRIVERS)

    @contextlib.asynccontextmanager
    async def running(self, **classes: str) -> AsyncIterator[Fleet]:
        core = Host()
        await core.start()
        repository = core.add("/repository", lambda address: Repository(address, contents()))
        registry = core.add("/registry", lambda address: Registry(address, repository=repository.address))
        assert isinstance(registry.component, Registry)
        assert isinstance(repository.component, Repository)
        self.registry, self.repository = registry.component, repository.component
        addresses = Addresses(repository=repository.address, registry=registry.address, task_manager=f"{core.url}/none")
        listeners = Listeners("127.0.0.1")
        for name, class_name in classes.items():
            make = partial(make_device, f"{self.data / 'drivers.py'}:{class_name}", name, None)
            self.devices[name] = HostedDevice(name, make, self.data, addresses, listeners)
        self._running = [asyncio.create_task(device.run()) for device in self.devices.values()]
        try:
            yield self
        finally:
            for task in self._running:
                task.cancel()
            await asyncio.wait(self._running)
            await listeners.stop()
            await core.stop()

    def addresses(self) -> dict[str, str]:
        """The addresses in the Registry, by the devices' names."""
        return {name: offer.address for name, provider in self.registry.state.providers.items() for offer in provider.offers.values()}

    def problem(self, name: str) -> Value | None:
        """What the map has as the problem of a device."""
        return self.repository.contents.map.objects[name].values.get(PROBLEM)

    def on_offer(self) -> set[str]:
        return set(self.registry.state.providers)


async def wait_until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(HANG_TIME):
        while not condition():
            await asyncio.sleep(0.01)


def test_a_device_that_does_not_start_is_tried_again_while_the_others_work(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with Fleet(tmp_path).running(Robot1="LateCarrier", Robot2="Carrier", Robot3="FaultyCarrier") as fleet:
            with pytest.raises(DeviceError, match="nothing answers at its port"):
                await fleet.devices["Robot1"].first_start
            with pytest.raises(DeviceError, match="ZeroDivisionError"):
                await fleet.devices["Robot3"].first_start
            await fleet.devices["Robot2"].first_start
            assert fleet.on_offer() == {"Robot2"}
            await wait_until(lambda: fleet.problem("Robot1") == "does not start: nothing answers at its port")
            (tmp_path / "on").touch()
            await wait_until(lambda: fleet.on_offer() == {"Robot1", "Robot2"} and not fleet.problem("Robot1"))

    asyncio.run(scenario())


def test_a_device_whose_disk_fails_is_started_again_and_the_others_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[tuple[str, Journal]] = []

    def open_journal(data: Path, name: str) -> Journal:
        opened.append((name, device_journal(data, name)))
        return opened[-1][1]

    monkeypatch.setattr(device_host, "device_journal", open_journal)

    async def scenario() -> None:
        async with Fleet(tmp_path).running(Robot1="Carrier", Robot2="Carrier") as fleet:
            addresses = [await device.first_start for device in fleet.devices.values()]
            journal = next(journal for name, journal in opened if name == "Robot2")
            journal.disk.write(lambda db: db.execute("INSERT INTO no_such_table VALUES (1)"))
            await wait_until(lambda: [name for name, _ in opened].count("Robot2") == 2)
            await wait_until(lambda: fleet.devices["Robot2"].starts == 2)
            assert fleet.addresses() == dict(zip(fleet.devices, addresses, strict=True)), "it is at its address again"
            assert [name for name, _ in opened].count("Robot1") == 1

    asyncio.run(scenario())


def test_devices_share_a_port_and_are_found_there_again(tmp_path: Path) -> None:
    async def scenario() -> list[str]:
        async with Fleet(tmp_path).running(Robot1="Carrier", Robot2="Carrier") as fleet:
            return [await device.first_start for device in fleet.devices.values()]

    first_addresses, second_addresses = asyncio.run(scenario()), asyncio.run(scenario())
    assert first_addresses == second_addresses
    assert len({address.split("/devices/")[0] for address in first_addresses}) == 1


def test_a_line_of_the_log_begins_with_its_device(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.handler.addFilter(name_device)

    async def scenario() -> None:
        async with Fleet(tmp_path).running(Robot2="LateCarrier") as fleet:
            with pytest.raises(DeviceError):
                await fleet.devices["Robot2"].first_start
            await asyncio.sleep(0)

    with caplog.at_level(logging.WARNING):
        asyncio.run(scenario())
    assert caplog.messages[0].startswith("Robot2 did not start: nothing answers at its port; it is tried again")


def test_a_device_of_a_command_line_has_a_name_and_a_driver() -> None:
    assert parse_device("Robot1=fork.py:Lifter") == ("Robot1", "fork.py:Lifter")
    for text in ("Robot1", "=fork.py:Lifter", "Robot1="):
        with pytest.raises(DeviceError, match="write NAME=module:Class"):
            parse_device(text)


def test_a_device_that_is_stopped_in_the_moment_in_which_it_joins_stops(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with Fleet(tmp_path).running(Robot1="Carrier") as fleet:
            await wait_until(lambda: fleet.on_offer() == {"Robot1"})

    for _ in range(5):
        asyncio.run(scenario())

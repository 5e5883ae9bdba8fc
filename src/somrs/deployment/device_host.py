"""Runs several devices in one process: each with its own Service Manager, address and journal, and each started again when it fails.

What ends one device does not end the others, unless it ends the process: then the system starts the process again, with all its devices.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from functools import partial
from pathlib import Path

from somrs.client.addresses import Addresses
from somrs.deployment.device import DeviceRunner, device_journal, first_of, last_port, listen, load, request
from somrs.deployment.program_certificates import give_devices_a_certificate
from somrs.deployment.programs import FIRST_PAUSE, MOST_PAUSE, run_program, until_stopped
from somrs.deployment.shared_map import MAPS, SharedMap
from somrs.errors import DeviceError, SomrsError
from somrs.runtime.bus_address import BusAddress
from somrs.runtime.host import Host
from somrs.service_manager.sdk.device import Device
from somrs.trust.credentials import Credentials

log = logging.getLogger(__name__)

_device: ContextVar[str] = ContextVar("device", default="")
"""The device for which the present task works."""


class Listeners:
    """The ports at which the devices of this process listen.

    Devices get the port of their last run again, because coordinators that have a contract know them by that address. New devices share a
    port.
    """

    def __init__(self, address: str, bus: BusAddress | None = None, credentials: Credentials | None = None) -> None:
        self._address, self._bus, self._credentials = address, bus, credentials
        self._hosts: dict[int, Host] = {}
        """By the ports at which they listen, and by those at which they could not."""
        self._lock = asyncio.Lock()
        self._shared_map: SharedMap | None = None

    def share_map(self, host: Host, name: str, repository: str) -> SharedMap:
        """The copy of the map for all devices; the first of their hosts keeps it, under the name of the first device."""
        if self._shared_map is None:
            self._shared_map = SharedMap(host, f"{MAPS}/{name}", repository, lambda body: request(host, body, repository))
        return self._shared_map

    async def find(self, port: int, name: str) -> Host:
        """The host that listens at a port of the last run, or in its place; for port 0, any."""
        async with self._lock:
            if (port == 0 or self._bus is not None) and self._hosts:
                return next(iter(self._hosts.values()))
            if port not in self._hosts:
                host = await listen(self._address, port, name, self._bus, self._credentials)
                self._hosts |= {port: host, host.port: host} if port else {host.port: host}
            return self._hosts[port] if port else next(iter(self._hosts.values()))

    async def stop(self) -> None:
        await asyncio.gather(*(host.stop() for host in {*self._hosts.values()}))


class HostedDevice:
    """A device that is started again whenever it fails, until its task is cancelled. `make`: makes it for each start."""

    def __init__(self, name: str, make: Callable[[], Device], data: Path, addresses: Addresses, listeners: Listeners) -> None:
        self.name = name
        self._make, self._data, self._addresses, self._listeners = make, data, addresses, listeners
        self.first_start: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        """Its address, or why it did not start."""
        self.starts = 0
        """How often it has started."""
        self._last_failure = ""

    async def run(self) -> None:
        """Start the device, and start it again after a pause when it has failed. It leaves in order when it is cancelled."""
        _device.set(self.name)
        pause = FIRST_PAUSE
        while True:
            try:
                await self._run_until_broken()
                log.error("%s could not store an input; it is started again", self.name)
                pause = FIRST_PAUSE
            except SomrsError as error:
                self._note_failure(error, error)
            except Exception as error:  # noqa: BLE001  # a defect of one driver must not end the devices of others
                self._note_failure(DeviceError(f"{type(error).__name__}: {error}; see the log of this program"), error)
            await asyncio.sleep(pause)
            pause = min(pause * 2, MOST_PAUSE)

    def _note_failure(self, error: SomrsError, cause: Exception) -> None:
        """Log a failure, once while it stays the same, and report the first start as failed."""
        if str(error) != self._last_failure:
            log.error("%s did not start: %s; it is tried again", self.name, error, exc_info=cause if cause is not error else None)
            self._last_failure = str(error)
        if not self.first_start.done():
            self.first_start.set_exception(error)

    async def _run_until_broken(self) -> None:
        device = self._make()
        journal = device_journal(self._data, self.name)
        try:
            host = await self._listeners.find(last_port(journal), self.name)
            shared_map = self._listeners.share_map(host, self.name, self._addresses.repository)
            runner = DeviceRunner(device, self._addresses, self._data, host, journal=journal, shared_map=shared_map)
            try:
                address = await runner.start()
                self._last_failure = ""
                self.starts += 1
                if not self.first_start.done():
                    self.first_start.set_result(address)
                await first_of(runner.wait_broken(), runner.wait_contested())
            finally:
                await runner.stop()
        finally:
            journal.close()


def make_device(driver: str, name: str, world: str | None) -> Device:
    """Make a device of the class that a driver names. Raises DeviceError."""
    return load(driver)(name, world)


async def serve_devices(drivers: Mapping[str, str], addresses: Addresses, data: Path, address: str = "127.0.0.1") -> None:
    """Run the devices, which have these drivers by their names, until this process receives SIGTERM or SIGINT.

    It is ready when each device has started or failed to; what failed is tried again.
    """
    give_devices_a_certificate(drivers, addresses, address)
    listeners = Listeners(address, addresses.bus)
    world = addresses.simulator or addresses.world
    devices = [
        HostedDevice(name, partial(make_device, driver, name, world), data, addresses, listeners) for name, driver in drivers.items()
    ]
    running = [asyncio.create_task(device.run()) for device in devices]
    try:
        starts = await asyncio.gather(*(device.first_start for device in devices), return_exceptions=True)
        failures = {device.name: start for device, start in zip(devices, starts, strict=True) if isinstance(start, BaseException)}
        problems = tuple(f"{name} did not start: {failure}" for name, failure in failures.items())
        await until_stopped("devices", ", ".join(start for start in starts if isinstance(start, str)), problems)
    finally:
        for task in running:
            task.cancel()
        await asyncio.wait(running)
        await listeners.stop()


def run_devices(drivers: Mapping[str, str], addresses: Addresses, data: Path, address: str = "127.0.0.1") -> None:
    """Run the devices until the process receives SIGTERM or SIGINT. Each line of the log has the time, and the device that it is about."""
    handler = logging.StreamHandler()
    handler.addFilter(name_device)
    logging.basicConfig(level=logging.WARNING, format="%(asctime)s  %(message)s", datefmt="%H:%M:%S", handlers=[handler])
    run_program(serve_devices(drivers, addresses, data, address))


def name_device(record: logging.LogRecord) -> bool:
    """Put the device before a message that does not begin with it."""
    name = _device.get()
    if name and not record.getMessage().startswith(name):
        record.msg = f"{name}: {record.msg}"
    return True


def parse_device(text: str) -> tuple[str, str]:
    """A device's name and driver, written as NAME=DRIVER. Raises DeviceError."""
    name, equals, driver = text.partition("=")
    if not (equals and name and driver):
        raise DeviceError(f"{text!r} does not name a device and its driver: write NAME=module:Class or NAME=file.py:Class")
    return name, driver

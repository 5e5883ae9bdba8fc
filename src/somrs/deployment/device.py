"""Runs a device: its Service Manager at an address, the author's coroutines on the event loop, its journal on disk.

An author's program ends with `run(Forklift)` and is called as `python forklift.py --name Forklift1 --data .somrs`.
"""

from __future__ import annotations

import argparse
import asyncio
import importlib
import importlib.util
import logging
import sys
import uuid
from pathlib import Path
from types import ModuleType
from urllib.parse import urlsplit

from somrs.client.client import Addresses
from somrs.deployment.programs import run_program, until_stopped
from somrs.errors import DeviceError, InputError, RemoteError
from somrs.kernel.component import Notified
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.runtime.host import Host
from somrs.runtime.node import Node, Report
from somrs.runtime.wire import retry_unanswered
from somrs.service_manager.participant.participant import SCHEMA, ServiceManager
from somrs.service_manager.participant.timers import DepartureRequested, Equipped, Observed
from somrs.service_manager.sdk import orders
from somrs.service_manager.sdk.device import Device, MapReader
from somrs.service_manager.sdk.orders import Halt, Perform, Quote, Undo
from somrs.service_manager.sdk.service_runner import carry_out
from somrs.storage.journal import Journal

log = logging.getLogger(__name__)

JOIN_TIME = 60.0
"""Seconds after which a device that could not join says so; it goes on trying."""

MAP_TIME = 60.0
"""Seconds for which a device waits for a Repository that does not answer."""

LEAVE_TIME = 5.0
"""Seconds that a device has to come to rest when its program is to end."""


def device_journal(data: Path, name: str) -> Journal:
    """The journal of a device, or of several in one process, which are `beside` each other then."""
    folder = data / "devices"
    folder.mkdir(parents=True, exist_ok=True)
    return Journal(folder / f"{name}.sqlite", SCHEMA)


class DeviceRunner:
    """A device at work: join with `start`, take leave with `stop`. `data` is where its journal is.

    Devices of one process can share a journal and a host: one port then, and what goes the same way goes together. Whoever made
    them for it starts and stops the host, and closes the journal.
    """

    def __init__(
        self,
        device: Device,
        addresses: Addresses,
        data: Path,
        host: str | Host = "127.0.0.1",
        *,
        journal: Journal | None = None,
    ) -> None:
        self.device = device
        device.data = data
        self._addresses = addresses
        self._own_journal = journal is None
        self._journal = journal if journal is not None else device_journal(data, device.name)
        self._host = host
        self._runtime: Host | None = None
        self._node: Node | None = None
        self._early: list[str] = []
        """What the device observed while it was opened."""
        self._joined: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    async def start(self) -> str:
        """Connect to the hardware, and join. Returns the address. Raises DeviceError when the device cannot join."""
        self.device.profile()  # a class that cannot be run is told of before anything is connected
        self._runtime = runtime = await self._listen()
        self.device.map = MapReader(self._ask)
        self.device.observer = self._observed
        await self.device.open()
        profile = self.device.profile()
        repository, registry = self._addresses.repository, self._addresses.registry
        self._node = runtime.add_journaled(
            f"/devices/{self.device.name}",
            lambda address: ServiceManager(profile, repository=repository, registry=registry),
            self._journal,
            carry_out=self._carry_out,
            # The author may have changed the device since its journal was written.
            notices=(Equipped(profile, repository, registry), *map(Observed, self._early)),
        )
        try:
            await asyncio.wait_for(asyncio.shield(self._joined), JOIN_TIME)
        except TimeoutError:
            raise RemoteError(
                f"{self.device.name} could not join within {JOIN_TIME:.0f} s: "
                f"no answer from {self._addresses.repository} or {self._addresses.registry}"
            ) from None
        return self._node.address

    @property
    def manager(self) -> ServiceManager:
        assert self._node is not None, "it was started"
        assert isinstance(self._node.component, ServiceManager), "that is what was put there"
        return self._node.component

    async def stop(self) -> None:
        """Take leave: withdraw the offers, bring what runs to a stop, and say so to whom it concerns."""
        if self._node is not None:
            self._node.feed(Notified(DepartureRequested()))
            end = asyncio.get_running_loop().time() + LEAVE_TIME
            while not self.manager.idle and asyncio.get_running_loop().time() < end:
                await asyncio.sleep(0.02)
            await self._node.flush(2.0)
            if isinstance(self._host, Host):
                await self._host.remove(self._node)
        if self._runtime is not None and self._runtime is not self._host:
            await self._runtime.stop()
        await self.device.close()
        if self._own_journal:
            self._journal.close()

    def _observed(self, situation: str) -> None:
        if self._node is None:
            self._early.append(situation)
        else:
            self._node.feed(Notified(Observed(situation)))

    async def _listen(self) -> Host:
        """Where the device was reached before, if that can be: those who have a contract with it know that address."""
        if isinstance(self._host, Host):
            return self._host
        port = urlsplit(self._journal.address).port or 0
        for candidate in dict.fromkeys((port, 0)):
            runtime = Host(self._host, candidate)
            try:
                await runtime.start()
            except (OSError, SystemExit, RemoteError, InputError):
                if candidate == 0:
                    raise
                log.warning("%s: port %d is taken, so those who waited for it have to find it anew", self.device.name, candidate)
            else:
                return runtime
        raise AssertionError("port 0 is always tried")

    async def _carry_out(self, task: object, report: Report) -> object:
        match task:
            case Quote() | Perform() | Halt() | Undo():
                return await carry_out(self.device, task, self._ask, report)
            case orders.Report(text, joined):
                log.log({True: logging.INFO, False: logging.ERROR, None: logging.WARNING}[joined], "%s", text)
                if joined is not None and not self._joined.done():
                    if joined:
                        self._joined.set_result(None)
                    else:
                        self._joined.set_exception(DeviceError(text))
                return None
            case _:
                raise RemoteError(f"a device cannot do {type(task).__name__}")

    async def _ask(self, body: Body) -> Body:
        """Ask the Repository. One that is started again meanwhile is waited for: that is no reason to refuse, or to fail."""
        header = Header(sender=ANONYMOUS, recipient=self._addresses.repository, message_id=uuid.uuid4().urn)
        runtime, question = self._runtime, Message(header=header, body=body)
        assert runtime is not None, "devices ask once they listen"
        return (await retry_unanswered(lambda: runtime.request(question), MAP_TIME)).body


async def serve(kind: type[Device], name: str, data: Path, host: str = "127.0.0.1") -> None:
    """Run a device until its process is told to end."""
    addresses = Addresses.read(data)
    runner = DeviceRunner(kind(name, addresses.simulator or addresses.world), addresses, data, host)
    try:
        await until_stopped(name, await runner.start())
    finally:
        await runner.stop()


def run_driver(driver: str, name: str, data: Path, host: str = "127.0.0.1") -> None:
    """Run a device of the class that `driver` names, until the process is told to end."""
    run_program(serve(load(driver), name, data, host))


def run(kind: type[Device]) -> None:
    """What a device author's program ends with."""
    parser = argparse.ArgumentParser(description=(kind.__doc__ or f"A {kind.__name__}").strip().splitlines()[0])
    parser.add_argument("--name", required=True, help="the device's object on the map")
    parser.add_argument("--data", "--system", type=Path, default=Path(".somrs"), help="the data folder of the running system")
    parser.add_argument("--host", default="127.0.0.1", help="the address to listen at")
    arguments = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(message)s")
    try:
        run_program(serve(kind, arguments.name, arguments.data, arguments.host))
    except (InputError, RemoteError) as error:
        print(error, file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)


def load(driver: str) -> type[Device]:
    """The class that `module:Class` or `file.py:Class` names. Raises DeviceError."""
    module_name, separator, name = driver.rpartition(":")
    if not separator or not module_name or not name:
        raise DeviceError(f"{driver!r} does not name a device's class: write module:Class or file.py:Class")
    try:
        module = _module_in(Path(module_name)) if module_name.endswith(".py") else importlib.import_module(module_name)
    except (ImportError, OSError, SyntaxError) as error:
        raise DeviceError(f"{driver}: {module_name} cannot be imported: {error}") from error
    kind = getattr(module, name, None)
    if not (isinstance(kind, type) and issubclass(kind, Device)):
        devices = [n for n, v in vars(module).items() if isinstance(v, type) and issubclass(v, Device) and v is not Device]
        raise DeviceError(f"{driver}: {module_name} has no class {name} that is a Device; it has {', '.join(devices) or 'none at all'}")
    return kind


def _module_in(file: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(file.stem, file)
    if spec is None or spec.loader is None:
        raise ImportError(f"{file} is no Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[file.stem] = module  # dataclasses and msgspec look their module up
    spec.loader.exec_module(module)
    return module

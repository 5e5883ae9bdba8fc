"""The adapters of a site: which there are, with what settings, and the programs that run them.

A site file names them under `adapters:`; options of `somrs up` add to it. What the system has put together is in a file of the data folder,
from which the programs read it.
"""

from __future__ import annotations

import asyncio
import importlib
import logging
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
from msgspec import Struct, structs

from somrs.client.addresses import Addresses
from somrs.deployment.device import request
from somrs.deployment.device_host import HostedDevice, Listeners, name_device
from somrs.deployment.device_problem import ProblemReporter
from somrs.deployment.program_certificates import certificate_of_devices, give_devices_a_certificate
from somrs.deployment.programs import run_program, until_stopped
from somrs.entish.parse import nearest
from somrs.errors import InputError, RemoteError, UsageError
from somrs.protocol.messages.bodies import Body
from somrs.runtime.trust_client import following
from somrs.service_manager.sdk.device import Device
from somrs.space.storeys import storey_heights
from somrs.trust.credentials import Credentials
from somrs.trust.mqtt_topics import EVERYTHING

if TYPE_CHECKING:
    from somrs.adapters.adapter import Adapter
    from somrs.ontology.files.loaded import AdapterEntry

log = logging.getLogger(__name__)

FILE = "adapters.json"
"""The file of the data folder with the adapters of the system."""

OWN = {
    "arcos": "somrs.adapters.arcos.adapter:ArcosAdapter",
    "ros2": "somrs.adapters.ros2.adapter:Ros2Adapter",
    "things": "somrs.adapters.things.adapter:ThingsAdapter",
    "vda5050": "somrs.adapters.vda5050.adapter:Vda5050Adapter",
}
"""The adapters of SO-MRS, by name. Sites name others as `module:Class` or `file.py:Class`."""


OWN_BROKER, BUS_BROKER = "own", "bus"
"""What the setting `broker` names besides addresses: a broker that is started with the system, and the servers of its bus. `own HOST:PORT`
says where the former is to listen."""


class AdapterSettings(Struct, frozen=True):
    """An adapter, the settings that it is made with, and the folder to which paths in them refer."""

    name: str
    settings: dict[str, Any]
    folder: str

    @property
    def label(self) -> str:
        """The name of its program: that of the class, for one of the site's own."""
        return self.name.rpartition(":")[2]

    def make(self) -> Adapter:
        """Make the adapter. Raises InputError."""
        adapter: Adapter = adapter_class(self.name, Path(self.folder))(self.settings, Path(self.folder))
        return adapter

    def own_broker(self) -> str | None:
        """Where the system's own broker is to listen for this adapter: HOST:PORT, or empty for any port; None if it needs none."""
        name, _, place = str(self.settings.get("broker", "")).partition(" ")
        return place.strip() if name == OWN_BROKER else None

    def with_broker(self, name: str, url: str, **further: object) -> AdapterSettings:
        """The same with the address of a broker, and with further settings, in place of this name, if that is its broker."""
        is_named = str(self.settings.get("broker", "")).partition(" ")[0] == name
        return structs.replace(self, settings={**self.settings, "broker": url, **further}) if is_named else self

    def at_bus(self, url: str | None, credentials: Credentials | None = None) -> AdapterSettings:
        """The same with the address of the bus, if that is its broker. `url`: where its servers are a broker. Raises UsageError if they are
        none."""
        if self.settings.get("broker") == BUS_BROKER and url is None:
            raise UsageError(
                f"adapters: {self.name}: broker: bus: there is no bus that is known to speak MQTT; start the system with `--bus`, say by "
                "`--mqtt` where the servers do that run already, or write `own` or mqtt://HOST:PORT"
            )
        files = {"authority": credentials.authority, "certificate": credentials.certificate, "key": credentials.key} if credentials else {}
        certificates = {"certificates": {name: str(file.resolve()) for name, file in files.items()}} if files else {}
        return self.with_broker(BUS_BROKER, url or "", **certificates)


def adapter_class(name: str, folder: Path) -> type[Any]:
    """The class of an adapter. Raises UsageError."""
    driver = OWN.get(name, name)
    module_name, separator, class_name = driver.rpartition(":")
    if not separator:
        hint = nearest(name, OWN) or f"there are {', '.join(OWN)}, and those written as module:Class or file.py:Class"
        raise UsageError(f"adapters: there is no adapter {name}; {hint}")
    try:
        if module_name.endswith(".py"):
            from somrs.deployment.device import module_in

            module = module_in(folder / module_name)
        else:
            module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        advice = f"pip install 'somrs[{name}]'" if name in OWN else "correct its name"
        raise UsageError(f"adapters: {name} cannot be loaded: {error}; {advice}") from error
    except (ImportError, OSError, SyntaxError) as error:
        raise UsageError(f"adapters: {name} cannot be loaded: {error}") from error
    kind = getattr(module, class_name, None)
    if not isinstance(kind, type):
        raise UsageError(f"adapters: {name}: {module_name} has no class {class_name}")
    return kind


def adapters_of(entries: Mapping[str, AdapterEntry], chosen: Mapping[str, Mapping[str, Any]]) -> list[AdapterSettings]:
    """The adapters of the site's files, and those of the command line, whose settings come before those of a file."""
    names = dict.fromkeys([*entries, *chosen])
    adapters = []
    for name in names:
        entry = entries.get(name)
        settings = {**(entry.settings if entry is not None else {}), **chosen.get(name, {})}
        adapters.append(AdapterSettings(name, settings, str((entry.folder if entry is not None else Path()).resolve())))
    return adapters


def store_adapters(adapters: Collection[AdapterSettings], data: Path) -> None:
    """Keep the adapters for their programs. Nobody else reads the file: it may have passwords of brokers."""
    file = data / FILE
    file.touch(mode=0o600)
    file.write_bytes(msgspec.json.encode([*adapters]))


def named_adapter(name: str, data: Path, site: Sequence[Path]) -> AdapterSettings:
    """The adapter with this name, of these files, or, without files, of the system that was started from this data folder.

    Raises UsageError if there is none.
    """
    adapters = adapters_of(_entries_of(site), {}) if site else _stored_adapters(data)
    for adapter in adapters:
        if adapter.name == name:
            return adapter
    owner = ", ".join(map(str, site)) if site else "the system"
    raise UsageError(f"{owner}: there is no adapter {name}; there are {', '.join(adapter.name for adapter in adapters) or 'none'}")


def _entries_of(site: Sequence[Path]) -> Mapping[str, AdapterEntry]:
    from somrs.ontology.files.loading import load

    try:
        return load(site).adapters
    except InputError:  # the map of an earlier run needs the files no more
        return {}


def _stored_adapters(data: Path) -> list[AdapterSettings]:
    try:
        return msgspec.json.decode((data / FILE).read_bytes(), type=list[AdapterSettings])
    except (OSError, msgspec.DecodeError) as error:
        raise UsageError(f"{data / FILE} cannot be read: {error}; start the system with `somrs up`, or name files with --site") from None


class HostedFleet:
    """The devices of an adapter in this process. `credentials`: with what the process proves who it is. Devices for which it may not speak
    get a certificate of their own."""

    def __init__(self, addresses: Addresses, data: Path, address: str, credentials: Credentials | None) -> None:
        self._addresses, self.data, self._address, self._credentials = addresses, data, address, credentials
        self._listeners = Listeners(address, addresses.bus)
        self._running: dict[str, asyncio.Task[None]] = {}
        self._own_listeners: dict[str, Listeners] = {}
        self._problems: dict[str, ProblemReporter] = {}
        """Of those that have no device yet."""

    def add(self, device: Device) -> None:
        earlier = self._running.get(device.name)
        device.simulator = self._addresses.simulator or self._addresses.world
        hosted = HostedDevice(device.name, lambda: device, self.data, self._addresses, self._listeners_for(device.name))
        hosted.first_start.add_done_callback(lambda start: start.cancelled() or start.exception())
        self._running[device.name] = asyncio.create_task(self._run(hosted, earlier))

    async def _run(self, hosted: HostedDevice, earlier: asyncio.Task[None] | None) -> None:
        if (reporter := self._problems.pop(hosted.name, None)) is not None:
            await reporter.close()
        if earlier is not None:
            earlier.cancel()
            await asyncio.wait({earlier})
        await hosted.run()

    def report_problem(self, name: str, problem: str | None) -> None:
        if name not in self._problems:
            self._problems[name] = ProblemReporter(name, partial(self._ask, name))
        self._problems[name].take(problem)

    async def _ask(self, name: str, body: Body) -> Body:
        host = await self._listeners_for(name).find(0, name)
        return await request(host, body, self._addresses.repository)

    def _listeners_for(self, name: str) -> Listeners:
        """The ports at which a device listens: those of all, or its own, where it proves who it is with a certificate of its own."""
        if self._credentials is None or self._credentials.identity.may_speak_for(name):
            return self._listeners
        if name not in self._own_listeners:
            certificate = certificate_of_devices([name], self._addresses, self._address)
            if certificate is None:
                speaker = self._credentials.name
                advice = f"invite {speaker} again, with --speaks-for {name}"
                log.warning("%s cannot take part: the certificate of %s may not speak for it; %s", name, speaker, advice)
                return self._listeners
            self._own_listeners[name] = Listeners(self._address, self._addresses.bus, Credentials(certificate))
        return self._own_listeners[name]

    async def remove(self, name: str) -> None:
        task = self._running.pop(name, None)
        if task is not None:
            task.cancel()
            await asyncio.wait({task})

    async def storeys(self) -> Mapping[str, float]:
        return await storeys_at(self._addresses)

    async def close(self) -> None:
        await asyncio.gather(*(reporter.close() for reporter in self._problems.values()))
        tasks = [*self._running.values()]
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)
        await asyncio.gather(*(listeners.stop() for listeners in (self._listeners, *self._own_listeners.values())))


async def storeys_at(addresses: Addresses) -> dict[str, float]:
    """The storeys of the building of a system, by name, with their heights in metres. It waits until the map is known."""
    from somrs.client.client import Client

    while True:
        try:
            async with Client(addresses) as client:
                ontology, map = await client.ontology(), await client.map()
        except RemoteError:
            await asyncio.sleep(1.0)
        else:
            return storey_heights(map, ontology)


async def serve_adapter(settings: AdapterSettings, addresses: Addresses, data: Path, address: str) -> None:
    """Run an adapter until this process is asked to stop. Raises InputError."""
    name = settings.name
    give_devices_a_certificate([settings.label, *settings.at_bus(addresses.mqtt).make().names], addresses, address, topics=[EVERYTHING])
    credentials = Credentials.of_environment()
    fleet = HostedFleet(addresses, data, address, credentials)
    adapter = settings.at_bus(addresses.mqtt, credentials).make()
    async with following(credentials):
        await _until_stopped(name, asyncio.create_task(adapter.run(fleet)))
    await fleet.close()


async def serve_simulated(settings: AdapterSettings, addresses: Addresses, address: str) -> None:
    """Be the other end of an adapter for robots of the simulator, until this process is asked to stop. Raises InputError."""
    name = settings.name
    robots = settings.at_bus(addresses.mqtt).make().simulated
    give_devices_a_certificate([f"{settings.label}-simulated", *robots], addresses, address, topics=[EVERYTHING])
    credentials = Credentials.of_environment()
    adapter = settings.at_bus(addresses.mqtt, credentials).make()
    if addresses.simulator is None:
        raise UsageError(f"the adapter {name} puts robots of the simulator behind its protocol, and this system has no simulator")
    async with following(credentials):
        await _until_stopped(f"{name}-simulated", asyncio.create_task(_simulate(adapter, addresses, addresses.simulator)))


async def _simulate(adapter: Adapter, addresses: Addresses, simulator: str) -> None:
    await adapter.simulate(simulator, await storeys_at(addresses))


async def _until_stopped(name: str, work: asyncio.Task[None]) -> None:
    """Wait until this process is asked to stop. Raises what ends the work before."""
    stopping = asyncio.create_task(until_stopped(name))
    await asyncio.wait({stopping, work}, return_when=asyncio.FIRST_COMPLETED)
    if stopping.done():
        work.cancel()
        await asyncio.wait({work})
        return
    stopping.cancel()
    work.result()
    raise UsageError(f"the adapter {name} has ended by itself")


def run_adapter(name: str, addresses: Addresses, data: Path, address: str, site: Sequence[Path] = (), *, is_simulated: bool) -> None:
    """Run an adapter, or the other end of it. Each line of the log has the time, and the device that it is about. `site`: as of
    `named_adapter`."""
    settings = named_adapter(name, data, site)
    handler = logging.StreamHandler()
    handler.addFilter(name_device)
    logging.basicConfig(level=logging.WARNING, format="%(asctime)s  %(message)s", datefmt="%H:%M:%S", handlers=[handler])
    run_program(serve_simulated(settings, addresses, address) if is_simulated else serve_adapter(settings, addresses, data, address))

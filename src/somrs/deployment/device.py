"""Runs a device: serves its Service Manager at an address, runs the author's coroutines on the event loop, keeps its journal on disk.

A device program ends with `run(Forklift)` and is started with `python forklift.py --name Forklift1 --data .somrs`.
"""

from __future__ import annotations

import argparse
import asyncio
import importlib
import importlib.util
import logging
import math
import sys
import uuid
from collections.abc import Coroutine
from pathlib import Path
from types import ModuleType
from urllib.parse import urlsplit

from msgspec import structs

from somrs.client.addresses import Addresses
from somrs.deployment.device_problem import ProblemReporter
from somrs.deployment.device_tasks import DeviceTasks
from somrs.deployment.passage import add_passage
from somrs.deployment.program_certificates import give_devices_a_certificate
from somrs.deployment.programs import others_ready, run_program, until_stopped
from somrs.deployment.road_robot import add_road_robot
from somrs.deployment.shared_map import MAPS, SharedMap
from somrs.devices.passage import PassageDevice
from somrs.devices.road.member import RoadMember
from somrs.errors import DeviceError, InputError, RemoteError, SomrsError
from somrs.kernel.component import Notified
from somrs.ports import is_reserved
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.protocol.messages.knowledge import QueryMap, ReadMap, UpdateMap
from somrs.protocol.messages.observations import Observation, observed_at
from somrs.runtime.bus_address import BusAddress
from somrs.runtime.host import Host
from somrs.runtime.node import Node, Report
from somrs.runtime.wire import retry_unanswered
from somrs.service_manager.participant.participant import SCHEMA, ServiceManager
from somrs.service_manager.participant.timers import DepartureRequested, Equipped, Observed, ServicesChanged
from somrs.service_manager.sdk import orders
from somrs.service_manager.sdk.device import Device
from somrs.service_manager.sdk.map_reader import MapReader
from somrs.service_manager.sdk.orders import Halt, Perform, Quote, Undo
from somrs.service_manager.sdk.service_runner import carry_out
from somrs.service_manager.sdk.tasks import TaskSubmitter
from somrs.storage.journal import Journal
from somrs.trust.credentials import Credentials

log = logging.getLogger(__name__)

PATIENCE = math.inf
"""Seconds for which a device repeats a request that the Repository or the Task Manager does not answer: until the service that needs the
answer is stopped. That they are away, however long, is no failure of the service."""

RIVAL_PAUSE = 1.0
"""Seconds after which it is asked again whether another program serves the device, when there was no answer."""

LEAVE_TIME = 5.0
"""Seconds that a device has to become idle when its program stops."""


def device_journal(data: Path, name: str) -> Journal:
    """The journal of a device, or the journal that several devices of one process share."""
    folder = data / "devices"
    folder.mkdir(parents=True, exist_ok=True)
    return Journal(folder / f"{name}.sqlite", SCHEMA)


def last_port(journal: Journal) -> int:
    """The port of the device in its last run; 0 if there was none."""
    return urlsplit(journal.address).port or 0


async def listen(host: str, port: int, name: str, bus: BusAddress | None = None, credentials: Credentials | None = None) -> Host:
    """Listen on the bus, or else at the port of the last run if it is free: coordinators that have a contract know the device by that
    address. After a run on a bus, it is the port of the bus's gateway, and may be reserved for another program."""
    for candidate in dict.fromkeys((0 if is_reserved(port) else port, 0)):
        runtime = Host(host, candidate, bus=bus, credentials=credentials)
        try:
            await runtime.start()
        except (OSError, SystemExit, RemoteError, InputError):
            if candidate == 0:
                raise
            log.warning("%s: port %d is taken, so clients have to look up its new address", name, candidate)
        else:
            return runtime
    raise AssertionError("port 0 is always tried")


def _rival_text(name: str, rival: str) -> str:
    """What is wrong when another program serves the device, and what to do. `rival`: the name of that program, if it has one."""
    program = f"the program {rival}" if rival else "another program"
    return (
        f"{program} on the bus serves {name}, too, and both would do what it is told; stop that one, or have this one leave {name} out: an "
        "adapter by its settings, `somrs up` by a type without a driver"
    )


class DeviceRunner:
    """Runs one device in this process: `start` joins the system, `stop` leaves it. `data` is the folder of its journal.

    Devices of one process can share a journal and a host: they then have one port, and messages to the same destination are sent
    together. The caller starts and stops a shared host, and closes a shared journal. They can share a copy of the map, too.
    """

    def __init__(
        self,
        device: Device,
        addresses: Addresses,
        data: Path,
        host: str | Host = "127.0.0.1",
        *,
        journal: Journal | None = None,
        shared_map: SharedMap | None = None,
    ) -> None:
        self.device = device
        device.data = data
        self._addresses = addresses
        self._own_journal = journal is None
        self._journal = journal if journal is not None else device_journal(data, device.name)
        self._host, self._shared_map = host, shared_map
        self._runtime: Host | None = None
        self._node: Node | None = None
        self._passage: Node | None = None
        """Its part in traffic, if it is a lift, a door, or a robot."""
        self._problem = ProblemReporter(device.name, self._ask)
        self._early: list[Observed] = []
        """What the device observed before it joined."""
        self._path = f"/devices/{device.name}"
        self._contested = asyncio.Event()
        self._was_opened = False
        """Whether the device was told to connect to its hardware, successfully or not."""
        self._joined: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    async def start(self) -> str:
        """Connect to the hardware, join the system when it is there, and return the device's address.

        Raises DeviceError when the device is rejected.
        """
        self.device.profile()  # reports an invalid class before anything is connected
        self._runtime = runtime = await self._listen()
        try:
            address = await self._join(runtime)
        except Exception as error:  # an author's mistake may be anything
            description = str(error) if isinstance(error, SomrsError) else f"{type(error).__name__}: {error}"
            self._problem.take(f"does not start: {description}")
            raise
        self._problem.confirm()
        return address

    async def _join(self, runtime: Host) -> str:
        await self._check_alone(runtime)
        self.device.map = MapReader(self._ask)
        self.device.tasks = TaskSubmitter(DeviceTasks(self.device.name, self._addresses, runtime.request, PATIENCE).ask)
        self.device.observer = self._observed
        self.device.problem_observer = self._problem.take
        self.device.publisher = self._services_changed
        if isinstance(self.device, RoadMember):
            self.device.whole_map = self._map_copy(runtime).whole
        self._was_opened = True
        await self.device.open()
        profile = self.device.profile()
        repository, (registry, *further_registries) = self._addresses.repository, self._addresses.registries_for(self.device.name)
        self._contested = runtime.contested(self._path)
        self._node = runtime.add_journaled(
            self._path,
            lambda address: ServiceManager(profile, repository=repository, registry=registry),
            self._journal,
            carry_out=self._carry_out,
            # The author may have changed the device since its journal was written.
            notices=(Equipped(profile, repository, registry, tuple(further_registries)), *self._early),
        )
        missing = f"{self.device.name} waits for an answer of {repository} or {registry} to join"
        await others_ready(asyncio.shield(self._joined), lambda: missing)
        if self._addresses.traffic is not None:
            self._passage = self._join_traffic(runtime, self._addresses.traffic)
        return self._node.address

    async def _check_alone(self, runtime: Host) -> None:
        """Raises DeviceError if another program on the bus serves the device: both would get all orders. When that has ended, this one can
        take its place. If it does not answer, its host may be lost, which the servers of the bus find out."""
        name, is_answered = self.device.name, False
        while not is_answered:
            try:
                rival = await runtime.rival(self._path)
                is_answered = True
            except RemoteError as error:
                log.warning("%s waits: %s", name, error)
                await asyncio.sleep(RIVAL_PAUSE)
        if rival is not None:
            raise DeviceError(_rival_text(name, rival))

    def _map_copy(self, runtime: Host) -> SharedMap:
        """The copy of the map that the devices of this process share, or one for this device alone."""
        if self._shared_map is None:
            name, repository = self.device.name, self._addresses.repository
            self._shared_map = SharedMap(runtime, f"{MAPS}/{name}", repository, lambda body: request(runtime, body, repository))
        return self._shared_map

    def _join_traffic(self, runtime: Host, traffic: str) -> Node | None:
        """Let the device take part in traffic, if it is a lift, a door, or a robot that drives where it is granted its way."""
        if isinstance(self.device, PassageDevice):
            return add_passage(runtime, self.device, traffic)
        if isinstance(self.device, RoadMember):
            return add_road_robot(runtime, self.device, self.device.name, traffic)
        return None

    @property
    def manager(self) -> ServiceManager:
        assert self._node is not None, "start was called"
        assert isinstance(self._node.component, ServiceManager), "start adds a ServiceManager"
        return self._node.component

    async def wait_broken(self) -> None:
        """Return when the device cannot continue, because an input could not be stored."""
        assert self._node is not None, "start was called"
        await self._node.broken.wait()

    async def wait_contested(self) -> None:
        """Raises DeviceError when another program has begun at the same time to serve the device, and is to go on."""
        await self._contested.wait()
        raise DeviceError(_rival_text(self.device.name, ""))

    async def stop(self) -> None:
        """Leave the system: withdraw the offers, stop running services, and notify their coordinators."""
        if self._passage is not None and self._runtime is not None:
            await self._runtime.remove(self._passage)
        await self._problem.close()
        if self._node is not None:
            if not self._node.broken.is_set():
                await self._leave(self._node)
            if isinstance(self._host, Host):
                await self._host.remove(self._node)
        if self._runtime is not None and self._runtime is not self._host:
            await self._runtime.stop()
        if self._was_opened:
            await self._close_device()
        if self._own_journal:
            self._journal.close()

    async def _leave(self, node: Node) -> None:
        node.feed(Notified(DepartureRequested()))
        end = asyncio.get_running_loop().time() + LEAVE_TIME
        while not self.manager.idle and asyncio.get_running_loop().time() < end:
            await asyncio.sleep(0.02)
        await node.flush(2.0)

    async def _close_device(self) -> None:
        """Release the hardware."""
        try:
            await self.device.close()
        except Exception:  # an author's mistake must not hide the error for which the device stops
            # When `open` has failed, there may be nothing to close.
            log.log(logging.ERROR if self._node is not None else logging.DEBUG, "%s cannot be closed", self.device.name, exc_info=True)

    def _observed(self, situation: str | None, observation: Observation) -> None:
        assert self._runtime is not None, "devices observe after they listen"
        observed = Observed(situation, observed_at(observation, self._runtime.clock.now()))
        if self._node is None:
            self._early.append(observed)
        else:
            self._node.feed(Notified(observed))

    def _services_changed(self) -> None:
        if self._node is not None:
            self._node.feed(Notified(ServicesChanged(self.device.profile())))

    async def _listen(self) -> Host:
        if isinstance(self._host, Host):
            return self._host
        return await listen(self._host, last_port(self._journal), self.device.name, self._addresses.bus)

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
        """Send a request to the Repository, and repeat it until it is answered: a service does not fail because the Repository restarts.

        What a device reports holds now, and not when the Repository is there again.
        """
        assert self._runtime is not None, "devices send requests after they listen"
        if isinstance(body, QueryMap | ReadMap) and self._shared_map is not None:
            return await self._shared_map.answer(body)
        if isinstance(body, UpdateMap):
            body = structs.replace(body, observation=observed_at(body.observation, self._runtime.clock.now()))
        return await self._request(body, self._addresses.repository)

    async def _request(self, body: Body, recipient: str) -> Body:
        assert self._runtime is not None, "devices send requests after they listen"
        return await request(self._runtime, body, recipient)


async def request(runtime: Host, body: Body, recipient: str) -> Body:
    """Send a request of a device and return the answer. It is repeated while there is none. Raises RemoteError."""
    header = Header(sender=ANONYMOUS, recipient=recipient, message_id=uuid.uuid4().urn)
    question = Message(header=header, body=body)
    return (await retry_unanswered(lambda: runtime.request(question), PATIENCE)).body


async def first_of(*waiting: Coroutine[object, object, None]) -> None:
    """Return, or raise, what the first of these does; the others are cancelled."""
    tasks = [asyncio.create_task(work) for work in waiting]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()


async def _serve(kind: type[Device], name: str, data: Path, host: str = "127.0.0.1") -> None:
    """Run a device until its process receives SIGTERM or SIGINT."""
    addresses = Addresses.read(data)
    give_devices_a_certificate([name], addresses, host)
    runner = DeviceRunner(kind(name, addresses.simulator or addresses.world), addresses, data, host)
    try:
        await first_of(until_stopped(name, await runner.start()), runner.wait_contested())
    finally:
        await runner.stop()


def run_driver(driver: str, name: str, data: Path, host: str = "127.0.0.1") -> None:
    """Run a device of the class that `driver` names until the process receives SIGTERM or SIGINT."""
    run_program(_serve(load(driver), name, data, host))


def run(kind: type[Device]) -> None:
    """Run a device class as a program: parse the command line and serve the device. The last call of a device program."""
    parser = argparse.ArgumentParser(description=(kind.__doc__ or f"A {kind.__name__}").strip().splitlines()[0])
    parser.add_argument("--name", required=True, help="the device's object on the map")
    parser.add_argument("--data", "--system", type=Path, default=Path(".somrs"), help="the data folder of the running system")
    parser.add_argument("--host", default="127.0.0.1", help="the address to listen at")
    arguments = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(message)s")
    try:
        run_program(_serve(kind, arguments.name, arguments.data, arguments.host))
    except (InputError, RemoteError) as error:
        print(error, file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)


def load(driver: str) -> type[Device]:
    """Import the device class that `module:Class` or `file.py:Class` names. Raises DeviceError."""
    module_name, separator, name = driver.rpartition(":")
    if not separator or not module_name or not name:
        raise DeviceError(f"{driver!r} does not name a device class: write module:Class or file.py:Class")
    try:
        module = module_in(Path(module_name)) if module_name.endswith(".py") else importlib.import_module(module_name)
    except (ImportError, OSError, SyntaxError) as error:
        raise DeviceError(f"{driver}: {module_name} cannot be imported: {error}") from error
    kind = getattr(module, name, None)
    if not (isinstance(kind, type) and issubclass(kind, Device)):
        devices = [n for n, v in vars(module).items() if isinstance(v, type) and issubclass(v, Device) and v is not Device]
        raise DeviceError(f"{driver}: {module_name} has no class {name} that is a Device; it has {', '.join(devices) or 'none'}")
    return kind


def module_in(file: Path) -> ModuleType:
    """Import a Python file. Raises ImportError or OSError."""
    spec = importlib.util.spec_from_file_location(file.stem, file)
    if spec is None or spec.loader is None:
        raise ImportError(f"{file} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[file.stem] = module  # dataclasses and msgspec look up the module of a class here
    spec.loader.exec_module(module)
    return module

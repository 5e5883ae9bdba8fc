"""A whole system on one machine: processes that are started and stopped together (`somrs up`). `supervision.py` keeps them running."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec
from msgspec.structs import replace

from somrs.access.oidc_settings import check_oidc
from somrs.access.store import AccessStore, access_files
from somrs.client.addresses import LAST_FILE, SYSTEM_FILE, Addresses
from somrs.client.client import Client
from somrs.deployment.bus import bus_address, check_reachable, discard_site, list_site, mqtt_url, site_name
from somrs.deployment.device_groups import DeviceGroup, group_devices
from somrs.deployment.devices_of_map import DevicePrograms, Selection, devices, is_symbolic, of_one_world, unsimulated
from somrs.deployment.launcher import Launcher, Process
from somrs.deployment.ports_of_programs import Part, Ports, ports_before, reserve_ports
from somrs.deployment.private_files import discard, make_private
from somrs.deployment.program import Program
from somrs.deployment.program_certificates import ProgramCertificates, certificates_of_programs
from somrs.deployment.programs import has_windows
from somrs.deployment.site_adapters import SiteAdapters
from somrs.deployment.task_managers import task_manager_count
from somrs.deployment.watchdog import BEAT_VARIABLE
from somrs.devices.link_security import SCHEME
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import UsageError
from somrs.ports import RESERVED, Reservation, check_address, until_listening
from somrs.runtime.bus_address import BusAddress
from somrs.storage.locking import is_in_use
from somrs.trust.credentials import FOLDER, VARIABLE, Credentials

log = logging.getLogger(__name__)

SITE_FILE = "site.json"
"""File in the data folder: the site files from which its map was made."""

REGISTRY, TASK_MANAGER, DEVICES, ADAPTER = "registry", "task-manager", "devices", "adapter"
"""Commands of `somrs run` of which a system may have several programs."""

BUS, GATEWAY, BROKER = "bus", "gateway", "broker"
"""Commands of `somrs run` on which all others rely, if the system is on a bus."""

_SETTINGS = {"SOMRS_BUS", "SOMRS_MQTT", "SOMRS_MQTT_SERVERS", "SOMRS_OIDC", "SOMRS_NAME", "SOMRS_SITE", "SOMRS_NEIGHBOURS", VARIABLE}
"""Variables from which `somrs run` would take settings that the system does not have."""

OWN_BUS = "own"
"""A bus that is started with the system."""


def site_of(data: Path) -> list[Path] | None:
    """The site files of the map in a data folder; None if it holds no map."""
    site_file = data / SITE_FILE
    if not site_file.exists() or not (data / "repository.sqlite").exists():
        return None
    return [Path(path) for path in msgspec.json.decode(site_file.read_bytes(), type=list[str])]


def check_unused(data: Path) -> None:
    """Raises UsageError if a system that runs has this data folder."""
    if not is_in_use(data / "repository.sqlite"):
        return
    try:
        gui = Addresses.read(data).gui
    except UsageError:
        gui = None
    window = f", in the browser at {gui}" if gui else ""
    advice = "stop it with Ctrl-C in its terminal, or select another folder with `--data`"
    raise UsageError(f"{data} is in use by a system that runs{window}; {advice}")


class System:
    """The processes of one system, its data folder, and its addresses. An asynchronous context manager.

    `simulates`: whether there is a simulator, if the map has no symbolic devices; without one, traffic is a program of its own.
    `world`: what moves the simulated world. `world_address`: host:port of a simulator or a symbolic world that runs already, or will, and
    that may have maps of other systems, too; None: the system starts its own.
    `launcher`: starts the programs; None: the system makes its own. `stop` ends it in either case.
    `devices_per_process`: how many devices share a process; None: as `group_devices` says.
    `task_managers`, `registries`: the number of Task Managers, and of Registries; None: as many as in the last run.
    `bus`: the URLs of the NATS servers on which the components are, `OWN_BUS` for one that is started with them, None for no bus; `name`:
    the site's name there.
    `mqtt`: the HOST:PORT, separated by commas, at which the bus is a broker for MQTT; None: a bus that is started with the components is
    one at a port of theirs, and of others it is not known.
    `neighbours`: the file of the neighbours of Registry and Repository; None: they have none.
    `adapters`: the settings of adapters, by their names, besides those of the site's files; `arcos`: the Pioneer robots of the map are
    driven by ARCOS, which the simulator speaks for them.
    `drivers`: programs of devices besides those of SO-MRS and those that the types of the site's files name.
    `secure`: people and programs say who they are at the API and the windows. `certificates`: see `certificates_of_programs`.
    `oidc`: the file of the provider at which people sign in; None: there is none.
    `first_port`: the ports are this one and those that follow, in the order of `Part`; None: those of the last run, where they are free.
    """

    def __init__(
        self,
        site: Sequence[Path],
        data: Path,
        *,
        speed: str = "1",
        world: WorldKind = WorldKind.PHYSICS,
        simulates: bool = True,
        host: str = "127.0.0.1",
        windows: bool = False,
        world_address: str | None = None,
        launcher: Launcher | None = None,
        devices_per_process: int | None = None,
        task_managers: int | None = None,
        registries: int | None = None,
        bus: str | None = None,
        mqtt: str | None = None,
        name: str | None = None,
        neighbours: Path | None = None,
        first_port: int | None = None,
        drivers: Collection[str] = (),
        secure: bool = True,
        certificates: bool | None = None,
        oidc: Path | None = None,
        adapters: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
        arcos: bool = False,
    ) -> None:
        self.site, self.data, self.host = [path.resolve() for path in site], data, host
        self._bus, self._mqtt, self._name, self._first_port, self._listed = bus, mqtt, name, first_port, False
        self.speed, self.world, self.simulates, self.secure = speed, world, simulates, secure
        self.programs: dict[str, Program] = {}
        self._windows, self._world_address, self._devices_per_process = windows, world_address, devices_per_process
        self._task_managers, self._registries, self._neighbours = task_managers, registries, neighbours
        self._oidc = oidc.resolve() if oidc is not None else None
        self.addresses = Addresses(repository="", registry="", task_manager="")
        self._device_programs = DevicePrograms(self.site, drivers)
        self._adapters = SiteAdapters(self.site, data, host, adapters, with_arcos=arcos)
        self.problems: list[str] = []
        """What was left out at the start, and why, for people."""
        self._reservation: Reservation | None = None
        self._chosen_certificates = partial(
            certificates_of_programs, data, host, site_name(self.site), certificates, secure=secure, neighbours=neighbours
        )
        self.certificates: ProgramCertificates | None = None
        self._launcher = launcher or Launcher()

    def _check_site(self) -> None:
        """Check that others can reach the host, and that the map of an earlier run was made from the same site files. Raises UsageError."""
        check_address(self.host)
        if (earlier_site := site_of(self.data)) not in (None, self.site):
            kept_map = f"{self.data} holds the map of {', '.join(map(str, earlier_site or ()))}"
            raise UsageError(f"{kept_map}; `--fresh` deletes it and starts with the new site, `--data` selects another folder")

    async def __aenter__(self) -> System:
        try:
            await self.start()
        except BaseException:  # also when Ctrl-C cancels it: no process may remain
            await self.stop()
            raise
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self.stop()

    async def discard(self) -> None:
        """Delete what its data folder and its bus have kept of it. Raises UsageError if it runs."""
        if self._bus is not None and self._bus != OWN_BUS:
            self.certificates = self._chosen_certificates()
            await discard_site(self._bus, self._name or site_name(self.site), self._bus_credentials())
        discard(self.data, keep=[*self.site, *access_files(self.data), self.data / FOLDER])

    def _prepare_access(self) -> None:
        """Make what its own programs prove with who they are. Raises UsageError."""
        self.certificates = self._chosen_certificates()
        if self.secure:
            AccessStore(self.data).renew_local_token()
        if self._oidc is not None:
            check_oidc(self._oidc, secure=self.secure)
        if self.certificates is not None:
            self.certificates.prepare()

    def _bus_credentials(self) -> Credentials | None:
        """With what this process uses the bus, if programs have certificates."""
        return self.certificates.of_bus() if self.certificates is not None else None

    async def start(self) -> None:
        """Start all programs. Return when all devices offer their services."""
        make_private(self.data)
        check_unused(self.data)
        self._prepare_access()
        ports = self._reserve_ports()
        self._check_site()
        await asyncio.to_thread(self._adapters.check, is_fresh=site_of(self.data) is None)
        bus = await self._start_bus(ports)
        self.addresses = replace(ports.addresses(bus, has_windows=self._windows and has_windows()), mqtt=self._mqtt_url(ports))
        site = [argument for path in self.site for argument in ("--site", str(path))]
        entrance = ["--port", str(ports[Part.REPOSITORY])] if bus is None else ["--bus", bus.servers, "--name", bus.site]
        neighbours = ["--neighbours", str(self._neighbours.resolve())] if self._neighbours is not None else []
        await self._start("repository", *entrance, *site, *neighbours)
        async with Client(self.addresses) as client:
            ontology, map = await client.ontology(), await client.map()
        adapted = await asyncio.to_thread(self._adapters.prepare, map, ontology, self.addresses.mqtt)
        for problem in self._adapters.misfits(map, ontology):
            self._report_problem(problem)
        own_devices = [device for device in devices(map, ontology) if device[0] not in adapted]
        driven = self._selected(await asyncio.to_thread(self._device_programs.select, own_devices))
        bodiless = is_symbolic(driven)
        driven = self._selected(of_one_world(driven, symbolic=bodiless))
        world_address = self._address_of_world(map.name if not bodiless else "") or ports.world
        has_world = bodiless or self.simulates
        if not has_world:
            driven = self._selected(unsimulated(driven, map, ontology))
        traffic_address = ports.traffic(bus) if self._world_address is None and not bodiless else None  # a running simulator has its own
        self.addresses = replace(
            self.addresses,
            world=world_address if bodiless else None,
            simulator=world_address if has_world and not bodiless else None,
            traffic=traffic_address,
            broker=self._adapters.broker or None,
        )
        # Not earlier: while another system uses this data folder, its addresses must stay in the file.
        self.addresses.write(self.data)
        self._listed = True
        (self.data / SITE_FILE).write_bytes(msgspec.json.encode([str(path) for path in self.site]))
        first = [self._start_one_of(REGISTRY, number, port, *neighbours) for number, port in enumerate(ports.registries, 1)]
        first += [self._start_one_of(TASK_MANAGER, number, port) for number, port in enumerate(ports.task_managers, 1)]
        first += [self._start("trust", "--port", str(ports[Part.TRUST]))] if self.certificates is not None else []
        if not has_world:
            first.append(self._start("traffic", "--port", str(ports[Part.TRAFFIC])))
        elif self._world_address is None:
            arguments = ["--port", str(ports[Part.WORLD]), "--speed", self.speed, *([] if bodiless else ["--world", self.world])]
            first.append(self._start("world" if bodiless else "simulator", *arguments))
        await asyncio.gather(*first)
        if self._world_address is not None:
            await until_listening(self._world_address)
        if self._adapters.needs_broker:
            host, port = self._adapters.broker_place
            await self._start(BROKER, "--host", host, "--port", str(port))
        await self._start_devices_and_clients(driven, ports)
        # Not earlier: when a start fails because an address is taken, the next start tries the same address again.
        self.addresses.write(self.data, LAST_FILE)
        if bus is not None:
            await list_site(self.addresses, self._bus_credentials())

    async def _start_devices_and_clients(self, driven: list[tuple[str, str]], ports: Ports) -> None:
        """Start what needs the others: the programs of devices, adapters, the scheduler, and the servers for people. `driven`: the devices
        with their drivers."""
        device_starts = [self._start_devices(group) for group in group_devices(driven, self._devices_per_process)]
        device_starts += [self._start_adapter(label, arguments) for label, arguments in self._adapters.programs()]
        access = "--secure" if self.secure else "--insecure"
        clients = [
            self._start("scheduler", "--port", str(ports[Part.SCHEDULER])),
            self._start("api", "--port", str(ports[Part.API]), access),
        ]
        if self.addresses.gui is not None:
            oidc = ["--oidc", str(self._oidc)] if self._oidc is not None else []
            clients.append(self._start("gui", "--port", str(ports[Part.WINDOWS]), access, *oidc))
        await asyncio.gather(*device_starts, *clients)

    def _address_of_world(self, map: str) -> str:
        """Where the map is in the world of a simulator that others run, which may have several; empty without such a simulator."""
        scheme, part = SCHEME if self.certificates is not None else "", f"/{map}" if map else ""
        return f"{scheme}{self._world_address}{part}" if self._world_address is not None else ""

    def _selected(self, selection: Selection) -> list[tuple[str, str]]:
        """The devices to start. Those that are left out are reported."""
        for problem in selection.problems:
            self._report_problem(problem)
        return selection.devices

    def _report_problem(self, problem: str) -> None:
        log.warning("%s", problem)
        self.problems.append(problem)

    def _reserve_ports(self) -> Ports:
        """Reserve the ports of all programs, those of the last run where they are free."""
        last_addresses = Addresses.of_last_run(self.data)
        last_counts = (len(last_addresses.task_managers), len(last_addresses.registries)) if last_addresses is not None else (1, 1)
        managers, registries = task_manager_count(self.data, self._task_managers, last_counts[0]), self._registries or last_counts[1]
        preferred_ports = (
            ports_before(last_addresses, task_managers=managers, is_on_bus=self._bus is not None, has_own_bus=self._bus == OWN_BUS)
            if last_addresses is not None
            else []
        )
        count = len(Part) + managers - 1 + registries - 1
        self._reservation = reserve_ports(self.host, count, preferred_ports, self._first_port)
        return Ports(self.host, self._reservation.ports, registries, self.certificates.folder if self.certificates is not None else None)

    async def _start_bus(self, ports: Ports) -> BusAddress | None:
        """Start the bus, if it is to be the system's own, and the site's gateway. Returns where the bus is, if there is one."""
        if self._bus is None:
            return None
        name = self._name or site_name(self.site)
        server_port, gateway_port = ports[Part.BUS], ports[Part.GATEWAY]
        bus_scheme, gateway_scheme = ("nats", "http") if self.certificates is None else ("tls", "https")
        servers = f"{bus_scheme}://{self.host}:{server_port}" if self._bus == OWN_BUS else self._bus
        bus = bus_address(servers, name, f"{gateway_scheme}://{self.host}:{gateway_port}")
        if self._bus == OWN_BUS:
            assert self._reservation is not None, "made before"
            self._reservation.release(server_port)
            self._reservation.release(ports[Part.MQTT])
            await self._start(BUS, "--port", str(server_port), "--mqtt", self._mqtt or f"{self.host}:{ports[Part.MQTT]}")
        else:
            await check_reachable(bus, self._bus_credentials())  # here, so that who starts the system reads why it does not go on
        await self._start(GATEWAY, "--bus", servers, "--name", name, "--port", str(gateway_port))
        return bus

    def _mqtt_url(self, ports: Ports) -> str | None:
        """Where the bus is a broker for MQTT; None if it is none, as far as is known. Raises UsageError for a wrong address."""
        own_address = f"{self.host}:{ports[Part.MQTT]}" if self._bus == OWN_BUS else None
        address = self._mqtt or own_address
        return mqtt_url(address, secure=self.certificates is not None) if self._bus is not None and address is not None else None

    async def _start_one_of(self, command: str, number: int, port: int, *arguments: str) -> Program:
        """Start the component with this number, of which a system may have several."""
        if number == 1:
            return await self._start(command, "--port", str(port), *arguments)
        return await self._start(command, "--port", str(port), "--number", str(number), *arguments, label=f"{command}-{number}")

    async def _start_devices(self, group: DeviceGroup) -> None:
        """Start devices. A program that ends its process is no reason for the others to stop."""
        try:
            await self._start(DEVICES, *(f"{name}={driver}" for name, driver in group.drivers.items()), label=group.name)
        except UsageError as error:
            self._report_problem(f"{group.name} did not start: {error}")

    async def _start_adapter(self, label: str, arguments: Sequence[str]) -> None:
        """Start the program of an adapter, or of its other end. One that ends is no reason for the others to stop."""
        try:
            await self._start(ADAPTER, *arguments, label=label)
        except UsageError as error:
            self._report_problem(f"{label} did not start: {error}")

    async def _start(self, command: str, *arguments: str, label: str = "") -> Program:
        """Start a program, and wait until it is ready."""
        name = label or command
        output = self.data / "logs" / f"{name}.log"
        output.parent.mkdir(exist_ok=True)
        line = ["run", command, *arguments, *(() if command == GATEWAY else ("--data", str(self.data)))]
        line += [] if "--host" in arguments else ["--host", self.host]
        output.unlink(missing_ok=True)
        beat_file = output.with_suffix(".beat")
        program = self.programs[name] = Program(name, line, await self._process(line, output, beat_file), output, beat_file)
        await program.ready()
        return program

    async def _process(self, arguments: list[str], output: Path, beat_file: Path) -> Process:
        assert self._reservation is not None, "made before the first program is started"
        environment = {name: value for name, value in self._reservation.environment.items() if name not in _SETTINGS}
        environment[RESERVED] = ",".join([environment[RESERVED], *map(str, self._adapters.ports)])
        beat_file.unlink(missing_ok=True)
        if self.certificates is not None:
            environment |= self.certificates.environment(output.stem, arguments)
        return await self._launcher.start(arguments, output, environment | {BEAT_VARIABLE: str(beat_file)})

    async def restart(self, name: str) -> None:
        """Start a program again after its end, and wait until it is ready. Raises UsageError or RemoteError when that fails."""
        program = self.programs[name]
        await program.process.wait()
        program.replace_process(await self._process(program.arguments, program.log, program.beat_file))
        await program.ready()

    async def stop(self) -> None:
        """Stop all programs: devices first, so that they can leave in order."""
        running = [program for program in reversed(self.programs.values()) if program.process.returncode is None]
        leaving, serving = {DEVICES, ADAPTER}, {BUS, GATEWAY, BROKER}
        devices, bus = ([program for program in running if program.arguments[1] in commands] for commands in (leaving, serving))
        core = [program for program in running if program not in devices and program not in bus]
        for group in (devices, core, bus):
            still_running = [program for program in group if program.process.returncode is None]
            for program in still_running:
                with contextlib.suppress(ProcessLookupError):  # it has just ended
                    program.process.send_signal(signal.SIGTERM)
            await asyncio.gather(*(program.end() for program in still_running))
        await self._launcher.stop()
        self._adapters.close()
        if self._reservation is not None:
            self._reservation.close()
        if self._listed:
            (self.data / SYSTEM_FILE).unlink(missing_ok=True)

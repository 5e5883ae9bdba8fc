"""Two organisations on hosts: a mill and a bakery, whose components two of the hosts run for each other as standbys.

Each has an authority of its own, and a bus of its own, with a server on each host.
"""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

from somrs.client.trace import trace_file
from somrs.demo.hosts import LOOPBACK, Host, Hosts, made_authority
from somrs.deployment.launcher import Launcher
from somrs.deployment.ports_of_programs import Part
from somrs.deployment.system import System
from somrs.devices.link_security import SCHEME
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ports import free_range
from somrs.trust.authority import Authority
from somrs.trust.credentials import FOLDER, Credentials

SPEED = "2"
"""Simulated seconds per second."""
MILL, BAKERY = "Mill", "Bakery"
ADDRESSES = {MILL: LOOPBACK, BAKERY: "127.0.0.2"}
"""Where the programs of each organisation are reached. With certificates, addresses of neighbours are told apart by their hosts."""
TASK_MANAGERS = {MILL: 1, BAKERY: 2}
LEADERS = {MILL: 0, BAKERY: 1}
"""The host that runs each organisation, by its position."""
_PORTS = 20
"""So many ports are kept for each organisation."""


def neighbours_of(organisation: str, gateways: Mapping[str, str]) -> str:
    """The file of an organisation that says what the other one may see and use, as YAML. `gateways`: the URLs of both."""
    if organisation == MILL:
        neighbour, permissions = BAKERY, "takes: nothing, gives: {providers: [MillRobot1]}, shows: [Dock, Bin4, MillRobot1], changes: true"
    else:
        neighbour, permissions = (
            MILL,
            "takes: all, gives: nothing, shows: [Ramp1, Ramp2, Counter, BakeryRobot1, BakeryRobot2], changes: true, simulates: true",
        )
    gateway = gateways[neighbour]
    addresses = f"registry: '{gateway}/registry', repository: '{gateway}/repository', authority: {neighbour.lower()}.pem"
    return f"{neighbour}: {{{addresses}, {permissions}}}\n"


def data_of(folder: Path, organisation: str) -> Path:
    """The data folder of an organisation's system."""
    return folder / "run" / organisation.lower()


def make_authorities(folder: Path) -> dict[str, Authority]:
    """The authorities of both, each of which gives the other one its certificate."""
    authorities = {name: made_authority(data_of(folder, name), name.lower(), ADDRESSES[name]) for name in (MILL, BAKERY)}
    for name, authority in authorities.items():
        (folder / f"{name.lower()}.pem").write_text(authority.public_certificate)
    return authorities


class Organisations:
    """Both organisations: their systems, which have gateways, devices and windows, and the hosts of their components."""

    def __init__(self, folder: Path, hosts: Hosts, launcher: Launcher | None) -> None:
        self._folder, self.hosts = folder, hosts
        ports = free_range(LOOPBACK, 2 * _PORTS)
        first_ports = {MILL: ports, BAKERY: ports + _PORTS}
        self._simulator_port = ports + 2 * _PORTS - 1
        self.gateways = {name: f"https://{ADDRESSES[name]}:{port + Part.GATEWAY}" for name, port in first_ports.items()}
        self._launchers = {MILL: launcher, BAKERY: None}
        self.systems = {name: self._system(name, port) for name, port in first_ports.items()}

    @property
    def simulator(self) -> str:
        """The address of the simulator, which is the mill's."""
        return f"{ADDRESSES[MILL]}:{self._simulator_port}"

    @property
    def operator(self) -> OperatorLink:
        """A link with which the mill observes the world."""
        client = Credentials(data_of(self._folder, MILL) / FOLDER / "programs" / "client.pem")
        return OperatorLink.at(f"{SCHEME}{self.simulator}", client)

    def _system(self, name: str, first_port: int) -> System:
        neighbours = self._folder / f"neighbours-of-{name.lower()}.yaml"
        neighbours.write_text(neighbours_of(name, self.gateways), encoding="utf-8")
        return System(
            [self._folder / f"{name.lower()}.yaml"],
            data_of(self._folder, name),
            host=ADDRESSES[name],
            world=WorldKind.KINEMATIC,
            world_address=self.simulator,
            launcher=self._launchers[name],
            task_managers=TASK_MANAGERS[name],
            bus=self.hosts.servers[name],
            name=name.lower(),
            neighbours=neighbours,
            first_port=first_port,
        )

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Both systems and the simulator, and then the hosts instead of the components that the systems began with."""
        launcher = Launcher()
        repositories = [option for gateway in self.gateways.values() for option in ("--repository", f"{gateway}/repository")]
        world = ["--world", "kinematic", "--speed", SPEED, "--port", str(self._simulator_port)]
        arguments = ["run", "simulator", *repositories, *world, "--data", str(data_of(self._folder, MILL))]
        simulator = await launcher.start(arguments, self._folder / "run" / "simulator.log", dict(os.environ))
        try:
            async with AsyncExitStack() as stack:
                await asyncio.gather(*map(stack.enter_async_context, self.systems.values()))
                for name in self.systems:
                    await self._move_to_hosts(name)
                yield
        finally:
            simulator.kill()
            await simulator.wait()
            await launcher.stop()

    async def _move_to_hosts(self, name: str) -> None:
        """Have a host follow the components of a system, and hand them over to it; then have another host follow them there."""
        leader, standby_host = self.hosts.hosts[LEADERS[name]], self.hosts.hosts[1 - LEADERS[name]]
        await self._start_components(leader, name)
        programs = [self.systems[name].programs[component] for component in _components(name)]
        for program in programs:
            program.process.send_signal(signal.SIGTERM)
        await self.hosts.led(component_labels(name))
        for program in programs:
            await program.process.wait()
        await self._start_components(standby_host, name)

    async def _start_components(self, host: Host, name: str) -> None:
        system, folder = self.systems[name], name.lower()
        for label, component in zip(component_labels(name), _components(name), strict=True):
            command, numbered = component.removesuffix("-2"), ["--number", "2"] if component.endswith("-2") else []
            options = [*numbered, "--bus", self.hosts.servers[name], "--name", folder]
            if command in ("repository", "registry"):
                options += ["--neighbours", str(self._folder / f"neighbours-of-{folder}.yaml")]
            if command == "repository":
                options += ["--site", str(system.site[0])]
            await host.start(label, command, *options, site=name, folder=folder)

    def message_files(self, name: str) -> list[tuple[int, Path]]:
        """The files with the messages of an organisation's Task Managers, on the hosts where they may run, with their numbers."""
        numbers = range(1, TASK_MANAGERS[name] + 1)
        return [(number, trace_file(host.data / name.lower(), number)) for host in self.hosts.hosts[:2] for number in numbers]


def _components(name: str) -> list[str]:
    """The components of an organisation, as its system calls their programs."""
    return ["repository", "registry", *("task-manager", "task-manager-2")[: TASK_MANAGERS[name]], "scheduler"]


def component_labels(name: str) -> list[str]:
    """The components of an organisation, as its hosts call them."""
    return [f"{name}/{component}" for component in _components(name)]


def task_manager_labels() -> list[str]:
    return [label for name in (MILL, BAKERY) for label in component_labels(name) if "task-manager" in label]


def name_in_chart(label: str) -> str:
    """What a Task Manager is called in the chart."""
    name, _, component = label.partition("/")
    return f"{name}'s TM {component.removeprefix('task-manager').removeprefix('-') or 1}"

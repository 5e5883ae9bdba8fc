"""Hosts of systems on buses that are lost for good. Here, a host is a set of processes, and a folder with their data.

Each site has a bus of its own, of which each host runs a server. All programs of a site at a host have one certificate, with the roles of
all of them.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec

from somrs.deployment.launcher import Launcher, Process
from somrs.deployment.program_certificates import ProgramCertificates
from somrs.deployment.programs import Ready
from somrs.errors import RemoteError
from somrs.ports import Reservation
from somrs.trust.authority import Authority
from somrs.trust.credentials import VARIABLE
from somrs.trust.identity import Identity, Role

LOOPBACK = "127.0.0.1"
SERVER = "bus"
ROLES = frozenset({Role.BUS, Role.REPOSITORY, Role.REGISTRY, Role.TASK_MANAGER, Role.SCHEDULER})
"""Those of what runs on a host."""


def made_authority(data: Path, site: str, host: str = LOOPBACK) -> Authority:
    """The authority of a site, which is made in its data folder, with the certificate with which its system uses the bus from there."""
    authority = Authority.of_data(data)
    ProgramCertificates(authority, host, site).of_bus()
    return authority


class Host:
    """The processes of a host, by labels, and its data folder. `change` is set whenever one of them takes over. `authorities`: by site."""

    def __init__(self, name: str, data: Path, launcher: Launcher, change: asyncio.Event, authorities: Mapping[str, Authority]) -> None:
        self.name, self.data = name, data
        identity = Identity(name=data.name, roles=ROLES)
        self._certificates = {
            site: authority.issue_program(identity, (LOOPBACK,), datetime.now(UTC))[0] for site, authority in authorities.items()
        }
        self._launcher = launcher
        self._processes: dict[str, Process] = {}
        self._is_standby: dict[str, bool] = {}
        self._reading: set[asyncio.Task[None]] = set()
        self._change = change

    async def start(self, label: str, *arguments: str, site: str, folder: str = "") -> None:
        """Start a program of a site, and return when it is ready. `folder`: for its data, in the host's. Raises RemoteError if it ends."""
        data = self.data / folder
        data.mkdir(parents=True, exist_ok=True)
        log = data / f"{label.replace('/', '-')}.log"
        environment = os.environ | {VARIABLE: str(self._certificates[site])}
        process = await self._launcher.start(["run", *arguments, "--data", str(data)], log, environment)
        self._processes[label] = process
        line = await process.stdout.readline()
        if not line:
            raise RemoteError(f"{label} of the {self.name} has ended: {log.read_text(errors='replace')[-500:]}")
        self._note(label, line)
        task = asyncio.create_task(self._read(label, process))
        self._reading.add(task)
        task.add_done_callback(self._reading.discard)

    async def _read(self, label: str, process: Process) -> None:
        while line := await process.stdout.readline():
            self._note(label, line)

    def _note(self, label: str, line: bytes) -> None:
        self._is_standby[label] = "(standby)" in msgspec.json.decode(line, type=Ready).address
        self._change.set()

    @property
    def leads(self) -> list[str]:
        """The components that it leads, by their labels."""
        return [label for label in self._processes if not _is_server(label) and not self._is_standby[label]]

    async def kill(self) -> None:
        """Kill all its processes at once."""
        await _end(self._given_up(), signal.SIGKILL)

    def take_out(self) -> asyncio.Task[None]:
        """Ask its components to end, and its server after them, as before maintenance. The task ends when they have."""
        return asyncio.create_task(_end_in_order(self._given_up()))

    def _given_up(self) -> dict[str, Process]:
        processes, self._processes = self._processes, {}
        self._is_standby.clear()
        return processes


def _is_server(label: str) -> bool:
    """Whether a program is a NATS server, by its label, as `_server_label` makes it."""
    return label.endswith(f"/{SERVER}")


def _server_label(site: str) -> str:
    return f"{site}/{SERVER}"


async def _end_in_order(processes: dict[str, Process]) -> None:
    await _end({label: process for label, process in processes.items() if not _is_server(label)}, signal.SIGTERM)
    await _end({label: process for label, process in processes.items() if _is_server(label)}, signal.SIGTERM)


async def _end(processes: dict[str, Process], signal_number: signal.Signals) -> None:
    for process in processes.values():
        with contextlib.suppress(ProcessLookupError):
            process.send_signal(signal_number)
    for process in processes.values():
        await process.wait()


class Hosts:
    """Hosts with a NATS server for each site, by its `authorities`. An asynchronous context manager; at its end, all are killed.

    `servers`: the URLs of the bus of each site. `change` is set whenever a component takes over.
    """

    def __init__(self, folder: Path, names: Sequence[str], authorities: Mapping[str, Authority]) -> None:
        self._launcher = Launcher()
        self.change = asyncio.Event()
        self.hosts = [Host(name, folder / name.replace(" ", "-"), self._launcher, self.change, authorities) for name in names]
        self._reservation = Reservation(LOOPBACK, 2 * len(names) * len(authorities))
        ports = iter(self._reservation.ports)
        self._ports = {site: [next(ports) for _ in names] for site in authorities}
        self._route_ports = {site: [next(ports) for _ in names] for site in authorities}
        self.servers = {site: ",".join(f"tls://{LOOPBACK}:{port}" for port in site_ports) for site, site_ports in self._ports.items()}

    async def __aenter__(self) -> Self:
        for port in self._reservation.ports:
            self._reservation.release(port)
        await asyncio.gather(*map(self.start_servers, self.hosts))
        return self

    async def __aexit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        for host in self.hosts:
            await host.kill()
        await self._launcher.stop()
        self._reservation.close()

    async def start_servers(self, host: Host) -> None:
        """Start the NATS servers of a host."""
        await asyncio.gather(*(self._start_server(host, site) for site in self.servers))

    async def _start_server(self, host: Host, site: str) -> None:
        number, route_ports = self.hosts.index(host), self._route_ports[site]
        ports = ["--port", str(self._ports[site][number]), "--cluster-port", str(route_ports[number])]
        routes = [argument for port in route_ports for argument in ("--route", f"{LOOPBACK}:{port}")]
        await host.start(_server_label(site), SERVER, *ports, *routes, site=site, folder=site.lower())

    def leader(self, label: str) -> Host | None:
        """The host that leads a component; None while none does."""
        return next((host for host in self.hosts if label in host.leads), None)

    async def led(self, labels: Sequence[str]) -> None:
        """Return when each of the components has a leader."""
        while any(self.leader(label) is None for label in labels):
            self.change.clear()
            await self.change.wait()

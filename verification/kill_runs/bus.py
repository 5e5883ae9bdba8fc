"""A site on a bus of three servers, whose components are on two hosts: each has a server and all components, one of them as standbys.

A host here is a set of processes and a data folder. The third host has a server only, so that two of three servers remain whichever is
killed. The gateway, the simulator and the devices are on other hosts, which are not killed.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
from pathlib import Path

import msgspec

from somrs.deployment.launcher import Launcher, Process
from somrs.deployment.programs import Ready
from somrs.deployment.system import System
from somrs.ports import Reservation

COMPONENTS = ("repository", "registry", "task-manager", "scheduler")
HOSTS = ("first", "second", "third")
LOOPBACK = "127.0.0.1"


class Host:
    """The processes of a host, and its data folder. `change` is set whenever one of its components takes over."""

    def __init__(self, name: str, data: Path, launcher: Launcher, change: asyncio.Event) -> None:
        self.name, self.data = name, data
        self._launcher = launcher
        self._processes: dict[str, Process] = {}
        self._is_standby: dict[str, bool] = {}
        self._reading: set[asyncio.Task[None]] = set()
        self._change = change

    async def start(self, label: str, *arguments: str) -> None:
        """Start a program, and return when it is ready."""
        log = self.data / f"{label}.log"
        process = await self._launcher.start(["run", *arguments, "--data", str(self.data)], log, os.environ)
        self._processes[label] = process
        line = await process.stdout.readline()
        if not line:
            raise OSError(f"{label} of the {self.name} host has ended: {log.read_text()[-500:]}")
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
        """The components that it leads."""
        return [component for component in COMPONENTS if component in self._processes and not self._is_standby[component]]

    async def kill(self) -> None:
        """Kill all its processes at once."""
        processes, self._processes = self._processes, {}
        self._is_standby.clear()
        for process in processes.values():
            process.kill()
        for process in processes.values():
            await process.wait()

    async def close(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            await self.kill()


class BusOfHosts:
    """The three hosts. An asynchronous context manager."""

    def __init__(self, folder: Path) -> None:
        self._launcher = Launcher()
        self._change = asyncio.Event()
        self.hosts = [Host(name, folder / name, self._launcher, self._change) for name in HOSTS]
        self._reservation = Reservation(LOOPBACK, 6)
        self._ports = self._reservation.ports
        self.servers = ",".join(f"nats://{LOOPBACK}:{port}" for port in self._ports[:3])
        self._killed: Host | None = None

    async def __aenter__(self) -> BusOfHosts:
        for host in self.hosts:
            host.data.mkdir(parents=True)
        for port in self._ports:
            self._reservation.release(port)
        await asyncio.gather(*map(self._start_server, range(3)))
        return self

    async def __aexit__(self, *exception: object) -> None:
        for host in self.hosts:
            await host.close()
        await self._launcher.stop()
        self._reservation.close()

    async def _start_server(self, number: int) -> None:
        routes = [argument for port in self._ports[3:] for argument in ("--route", f"{LOOPBACK}:{port}")]
        ports = ["--port", str(self._ports[number]), "--cluster-port", str(self._ports[number + 3])]
        await self.hosts[number].start("bus", "bus", *ports, *routes)

    async def _start_components(self, host: Host, site: Path) -> None:
        for component in COMPONENTS:
            site_option = ["--site", str(site)] if component == "repository" else []
            await host.start(component, component, "--bus", self.servers, *site_option)

    async def replace_components_of(self, system: System, site: Path) -> None:
        """Have two hosts follow the components of a system, and take over from them: they are killed, and not started again."""
        for host in self._with_components:
            await self._start_components(host, site)
        for component in COMPONENTS:
            system.programs[component].process.kill()
        await self.taken_over()

    @property
    def _with_components(self) -> list[Host]:
        return self.hosts[:2]

    @property
    def message_files(self) -> list[Path]:
        """The files with the messages of the Task Managers."""
        return [host.data / "messages.jsonl" for host in self._with_components]

    async def kill_leader(self) -> None:
        """Kill the host that leads the Task Manager, for good."""
        [self._killed] = [host for host in self.hosts if "task-manager" in host.leads]
        await self._killed.kill()

    async def taken_over(self) -> None:
        """Return when every component has a leader."""
        while len([component for host in self.hosts for component in host.leads]) < len(COMPONENTS):
            await self._change.wait()
            self._change.clear()

    async def bring_back(self, site: Path) -> None:
        """Start the host that was killed again, for the next run: its components become standbys."""
        if self._killed is not None:
            await self._start_server(self.hosts.index(self._killed))
            await self._start_components(self._killed, site)
            self._killed = None

"""Hosts of a system on a bus that are lost for good. Here, a host is a set of processes, and a folder with their data."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec

from somrs.deployment.launcher import Launcher, Process
from somrs.deployment.programs import Ready
from somrs.errors import RemoteError
from somrs.ports import Reservation

LOOPBACK = "127.0.0.1"
SERVER = "bus"
"""The label of a host's NATS server."""


class Host:
    """The processes of a host, by labels, and its data folder. `change` is set whenever one of them takes over."""

    def __init__(self, name: str, data: Path, launcher: Launcher, change: asyncio.Event) -> None:
        self.name, self.data = name, data
        self._launcher = launcher
        self._processes: dict[str, Process] = {}
        self._is_standby: dict[str, bool] = {}
        self._reading: set[asyncio.Task[None]] = set()
        self._change = change

    async def start(self, label: str, *arguments: str, folder: str = "") -> None:
        """Start a program, and return when it is ready. `folder`: that of its site, in the host's. Raises RemoteError if it ends."""
        data = self.data / folder
        data.mkdir(parents=True, exist_ok=True)
        log = data / f"{label.replace('/', '-')}.log"
        process = await self._launcher.start(["run", *arguments, "--data", str(data)], log, os.environ)
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
        return [label for label in self._processes if label != SERVER and not self._is_standby[label]]

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


async def _end_in_order(processes: dict[str, Process]) -> None:
    server = {label: process for label, process in processes.items() if label == SERVER}
    await _end({label: process for label, process in processes.items() if label != SERVER}, signal.SIGTERM)
    await _end(server, signal.SIGTERM)


async def _end(processes: dict[str, Process], signal_number: signal.Signals) -> None:
    for process in processes.values():
        with contextlib.suppress(ProcessLookupError):
            process.send_signal(signal_number)
    for process in processes.values():
        await process.wait()


class Hosts:
    """Hosts with a NATS server each, which are one bus. An asynchronous context manager; at its end, all are killed.

    `servers`: the URLs of the bus. `change` is set whenever a component takes over.
    """

    def __init__(self, folder: Path, names: Sequence[str]) -> None:
        self._launcher = Launcher()
        self.change = asyncio.Event()
        self.hosts = [Host(name, folder / name.replace(" ", "-"), self._launcher, self.change) for name in names]
        self._reservation = Reservation(LOOPBACK, 2 * len(names))
        ports = self._reservation.ports
        self._ports, self._route_ports = ports[: len(names)], ports[len(names) :]
        self.servers = ",".join(f"nats://{LOOPBACK}:{port}" for port in self._ports)

    async def __aenter__(self) -> Self:
        for port in (*self._ports, *self._route_ports):
            self._reservation.release(port)
        await asyncio.gather(*map(self.start_server, self.hosts))
        return self

    async def __aexit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        for host in self.hosts:
            await host.kill()
        await self._launcher.stop()
        self._reservation.close()

    async def start_server(self, host: Host) -> None:
        """Start the NATS server of a host."""
        number = self.hosts.index(host)
        routes = [argument for port in self._route_ports for argument in ("--route", f"{LOOPBACK}:{port}")]
        await host.start(SERVER, SERVER, "--port", str(self._ports[number]), "--cluster-port", str(self._route_ports[number]), *routes)

    def leader(self, label: str) -> Host | None:
        """The host that leads a component; None while none does."""
        return next((host for host in self.hosts if label in host.leads), None)

    async def led(self, labels: Sequence[str]) -> None:
        """Return when each of the components has a leader."""
        while any(self.leader(label) is None for label in labels):
            self.change.clear()
            await self.change.wait()

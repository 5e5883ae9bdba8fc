"""SO-MRS on one machine with a process for each component; five devices share a process, an address and a file.

The components exchange SOAP over HTTP, or msgpack over NATS with their journals on the bus as well.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Coroutine, Sequence
from datetime import UTC, datetime
from pathlib import Path

from contestants.contest import BIDDERS
from contestants.programs import Programs, free_port, ready, wait_for_end
from contestants.somrs_parts import CARRIERS, Carrier, Lines, folder, one_step, site
from somrs.client.addresses import Addresses
from somrs.deployment.bus import addresses_on
from somrs.deployment.bus_server import run_bus
from somrs.deployment.components import run_registry, run_repository
from somrs.deployment.continuation import continuing
from somrs.deployment.device import DeviceRunner, device_journal
from somrs.deployment.programs import run_program, until_stopped
from somrs.planner.model.problem import Problem
from somrs.protocol.messages.envelope import Message
from somrs.runtime.bus import Bus
from somrs.runtime.bus_address import BusAddress
from somrs.runtime.host import Host
from somrs.runtime.node import Report
from somrs.runtime.wire import Wire
from somrs.storage.journal import Journal
from somrs.task_manager.manager import SCHEMA, TaskManager
from somrs.trust.authority import Authority
from somrs.trust.credentials import VARIABLE, Credentials
from somrs.trust.identity import Identity, Role

HOST = "127.0.0.1"
GROUP = BIDDERS // 2
"""The number of devices in one process."""


class Certificates:
    """The certificates of the programs, if they have some: those of an authority in the data folder."""

    def __init__(self, data: Path, *, are_wanted: bool) -> None:
        self._authority = Authority.of_data(data) if are_wanted else None
        if self._authority is not None:
            self._authority.create("bench", datetime.now(UTC))

    def of(self, name: str, role: Role, speaks_for: Sequence[str] = ()) -> Path | None:
        if self._authority is None:
            return None
        identity = Identity(name=name, roles=frozenset({role}), speaks_for=frozenset(speaks_for))
        return self._authority.issue_program(identity, (HOST,), datetime.now(UTC))[0]

    def credentials(self) -> Credentials | None:
        """Those of the clients."""
        certificate = self.of("client", Role.CLIENT)
        return Credentials(certificate) if certificate is not None else None

    async def start(self, programs: Programs, part: str, argument: str) -> None:
        """Start a program of this module, with its certificate."""
        if part == "devices":
            certificate = self.of(f"devices-{argument}", Role.DEVICE, CARRIERS[int(argument) : int(argument) + GROUP])
        else:
            certificate = self.of(part, Role(part.removesuffix("-2")))
        environment = {VARIABLE: str(certificate)} if certificate is not None else {}
        await programs.start("somrs_wire", part, argument, environment=environment)


class OverHttp:
    """The clients' process, which starts the others."""

    has_certificates = False

    async def start(self, data: Path) -> None:
        certificates = Certificates(data, are_wanted=self.has_certificates)
        self._programs, self._wire = Programs(data), Wire(certificates.credentials())
        (data / "site.yaml").write_text(site())
        scheme = "https" if self.has_certificates else "http"
        ports = [free_port() for _ in range(3)]
        addresses = Addresses(
            repository=f"{scheme}://{HOST}:{ports[0]}/repository",
            registry=f"{scheme}://{HOST}:{ports[1]}/registry",
            task_manager=f"{scheme}://{HOST}:{ports[2]}/task-manager",
        )
        addresses.write(data)
        for part, port in zip(("repository", "registry", "task-manager"), ports, strict=True):
            await certificates.start(self._programs, part, str(port))
        for first in range(0, BIDDERS, GROUP):
            await certificates.start(self._programs, "devices", str(first))
        self._lines = Lines(self._ask, addresses.task_manager)
        await self._lines.until_offered(addresses.registry)

    async def converse(self, line: int) -> None:
        await self._lines.converse(line)

    async def stop(self) -> None:
        await self._wire.close()
        await self._programs.end()

    async def _ask(self, message: Message) -> Message:
        answer = await self._wire.post(message, timeout=90.0)
        assert answer is not None, "a request gets an answer"
        return answer


class OverHttps(OverHttp):
    """The same with certificates."""

    has_certificates = True


class OnBus:
    """The clients' process, which starts the others, with a bus of one server. Nobody needs a gateway here."""

    task_managers: tuple[str, ...] = ("task-manager",)
    has_certificates = False

    async def start(self, data: Path) -> None:
        certificates = Certificates(data, are_wanted=self.has_certificates)
        self._programs, credentials = Programs(data), certificates.credentials()
        (data / "site.yaml").write_text(site())
        port = free_port()
        bus_scheme, scheme = ("tls", "https") if self.has_certificates else ("nats", "http")
        bus = BusAddress(servers=f"{bus_scheme}://{HOST}:{port}", site="bench", gateway=f"{scheme}://{HOST}:1")
        addresses = addresses_on(bus)
        addresses.write(data)
        for part in ("bus", "repository", "registry", *self.task_managers):
            await certificates.start(self._programs, part, str(port))
        for first in range(0, BIDDERS, GROUP):
            await certificates.start(self._programs, "devices", str(first))
        self._bus = Bus(bus, credentials)
        await self._bus.start()
        self._lines = [Lines(self._ask, f"{bus.gateway}/{name}") for name in self.task_managers]
        await self._lines[0].until_offered(addresses.registry)

    async def converse(self, line: int) -> None:
        await self._lines[line % len(self._lines)].converse(line)

    async def stop(self) -> None:
        await self._bus.close()
        await self._programs.end()

    async def _ask(self, message: Message) -> Message:
        answer = await self._bus.post(message, timeout=90.0)
        assert answer is not None, "a request gets an answer"
        return answer


class OnSecureBus(OnBus):
    """The same with certificates."""

    has_certificates = True


class OnBusWithTwo(OnBus):
    """The same with two Task Managers, each of which has half of the conversations."""

    task_managers = ("task-manager", "task-manager-2")


async def _task_manager(name: str, data: Path, port: int) -> None:
    """Run a Task Manager as `somrs.deployment.programs` does, except for the plans."""
    addresses, file = Addresses.read(data), data / f"{name}.sqlite"

    async def plan(task: object, report: Report) -> object:
        assert isinstance(task, Problem), task
        return one_step(task)

    async with (
        continuing(addresses.bus, name, file, lambda log: Journal(file, SCHEMA, log=log)) as continuation,
        Host(HOST, port, bus=addresses.bus) as host,
    ):
        await continuation.add(
            host,
            f"/{name}",
            lambda address: TaskManager(address, repository=addresses.repository, registry=addresses.registry),
            carry_out=plan,
        )
        ready()
        await until_stopped()


async def _devices(data: Path, first: int) -> None:
    addresses = Addresses.read(data)
    journal = device_journal(data, str(first))
    host = Host(HOST, bus=addresses.bus)
    await host.start()
    runners = [
        DeviceRunner(Carrier(name), addresses, data, host, journal=journal.for_component(name)) for name in CARRIERS[first : first + GROUP]
    ]
    for runner in runners:
        await runner.start()
    ready()
    await until_stopped()
    for runner in runners:
        await runner.stop()
    await host.stop()
    journal.close()


def _part(name: str, number: int) -> Coroutine[None, None, None]:
    data = Path.cwd()
    match name:
        case "repository":
            return run_repository(folder(data, "repository"), [data / "site.yaml"], HOST, number, Addresses.read(data).bus)
        case "bus":
            return run_bus(folder(data, "bus"), HOST, number)
        case "registry":
            return run_registry(folder(data, "registry"), Addresses.read(data), HOST, number)
        case "task-manager" | "task-manager-2":
            return _task_manager(name, data, number)
        case _:
            return _devices(data, number)


async def _run(name: str, number: int) -> None:
    running = asyncio.create_task(_part(name, number))
    end_request = asyncio.create_task(wait_for_end())
    await asyncio.wait((running, end_request), return_when=asyncio.FIRST_COMPLETED)
    if not running.done():
        os.kill(os.getpid(), signal.SIGTERM)
    end_request.cancel()
    await running


if __name__ == "__main__":
    run_program(_run(sys.argv[1], int(sys.argv[2])))

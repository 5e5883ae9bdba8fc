"""A bus with certificates for tests: a real NATS server, which `run_bus` runs in this process's event loop."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from pathlib import Path

import nats
from nats.aio.client import Client

from somrs.deployment.bus_server import run_bus
from somrs.ports import listen_at
from somrs.runtime.bus import Bus
from somrs.runtime.bus_address import BusAddress
from somrs.trust.authority import Authority
from somrs.trust.credentials import Credentials
from somrs.trust.identity import Identity, Role


def free_port() -> int:
    with listen_at("127.0.0.1", 0) as free:
        port: int = free.getsockname()[1]
        return port


class SecureBus:
    """The bus of the site `yard`, its authority, and the address of its gateway, at which nobody listens yet."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.authority = Authority.of_data(folder)
        self.authority.create("yard", datetime.now(UTC))
        self.gateway_port = free_port()
        self.mqtt = f"127.0.0.1:{free_port()}"
        """Where it is a broker, if it is one."""
        self.address = BusAddress(servers=f"tls://127.0.0.1:{free_port()}", site="yard", gateway=f"https://127.0.0.1:{self.gateway_port}")

    def enrolled(self, name: str, role: Role, *, now: datetime | None = None) -> Credentials:
        """The credentials of a program of the site."""
        identity = Identity(name=name, roles=frozenset({role}))
        certificate, _ = self.authority.issue_program(identity, ("127.0.0.1",), now if now is not None else datetime.now(UTC))
        return Credentials(certificate)

    async def known(self, credentials: Credentials) -> None:
        """Return when the servers know who has these."""
        bus = Bus(self.address, credentials)
        await bus.start()
        await bus.close()

    async def connected(self, credentials: Credentials | None, errors: list[str]) -> Client:
        """A connection that does not do what SO-MRS does. `errors`: gets what the server says is wrong."""

        async def note(error: Exception) -> None:
            errors.append(str(error))

        tls = {"tls": credentials.client, "tls_handshake_first": True} if credentials is not None else {}
        name = credentials.name if credentials is not None else "nobody"
        return await nats.connect(
            self.address.servers, allow_reconnect=False, max_reconnect_attempts=0, error_cb=note, inbox_prefix=f"_INBOX.{name}", **tls
        )


@asynccontextmanager
async def running(
    folder: Path, servers: str, credentials: Credentials, cluster_port: int = 0, routes: Sequence[str] = (), mqtt: str | None = None
) -> AsyncIterator[asyncio.Task[None]]:
    """A server of a bus."""
    port = int(servers.rpartition(":")[2])
    task = asyncio.create_task(run_bus(folder, "127.0.0.1", port, cluster_port, routes, credentials, mqtt))
    try:
        yield task
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


@asynccontextmanager
async def secure_bus(folder: Path, *, mqtt: bool = False) -> AsyncIterator[SecureBus]:
    """A bus with one server, which is there, and is a broker for MQTT, too, if asked for."""
    bus = SecureBus(folder)
    credentials = bus.enrolled("bus", Role.BUS)
    async with running(folder, bus.address.servers, credentials, mqtt=bus.mqtt if mqtt else None):
        await bus.known(credentials)
        yield bus

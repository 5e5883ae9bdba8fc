"""A client that speaks for a device, with a certificate of the system's authority."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from pathlib import Path

from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.runtime.wire import Wire
from somrs.trust.authority import Authority
from somrs.trust.credentials import Credentials
from somrs.trust.identity import Identity, Role


@asynccontextmanager
async def device_client(addresses: Addresses, name: str) -> AsyncIterator[Client]:
    """A client of a system with certificates for the device with this name."""
    assert addresses.trust is not None, "the system has certificates"
    identity = Identity(name=name, roles=frozenset({Role.DEVICE}))
    certificate, _ = Authority(Path(addresses.trust)).issue_program(identity, ("127.0.0.1",), datetime.now(UTC))
    wire = Wire(Credentials(certificate))
    try:
        async with Client(addresses, wire.post) as client:
            yield client
    finally:
        await wire.close()

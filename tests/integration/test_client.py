"""A client of a part that is away for a while."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.errors import RemoteError
from somrs.ports import Reservation
from somrs.protocol.messages.directory import Discover, Discovered
from somrs.registry.component import Registry
from somrs.runtime.host import Host
from tests.support.hang import HANG_TIME

LOOPBACK = "127.0.0.1"


@contextmanager
def addresses() -> Iterator[Addresses]:
    """Where nobody listens until somebody does."""
    with Reservation(LOOPBACK, 1) as reserved:
        yield Addresses(repository="", registry=f"http://{LOOPBACK}:{reserved.ports[0]}/registry", task_manager="")


async def registry_at(address: str) -> Host:
    host = Host(LOOPBACK, int(address.rpartition(":")[2].partition("/")[0]))
    await host.start()
    host.add("/registry", Registry)
    return host


def test_a_patient_client_waits_for_a_part_that_is_started() -> None:
    async def run() -> Discovered:
        with addresses() as client_addresses:
            async with Client(client_addresses) as client:
                pending_reply = asyncio.create_task(client.ask(client_addresses.registry, Discover(), Discovered, patience=20))
                await asyncio.sleep(0.3)
                assert not pending_reply.done()
                host = await registry_at(client_addresses.registry)
                try:
                    return await pending_reply
                finally:
                    await host.stop()

    assert asyncio.run(run()).offers == ()


def test_other_clients_are_told_at_once_that_nobody_is_there() -> None:
    async def run() -> None:
        with addresses() as client_addresses:
            async with Client(client_addresses) as client:
                await asyncio.wait_for(client.ask(client_addresses.registry, Discover(), Discovered), HANG_TIME)

    with pytest.raises(RemoteError, match="cannot be reached"):
        asyncio.run(run())


def test_even_a_patient_client_gives_up() -> None:
    async def run() -> None:
        with addresses() as client_addresses:
            async with Client(client_addresses) as client:
                await asyncio.wait_for(client.ask(client_addresses.registry, Discover(), Discovered, patience=0.3), HANG_TIME)

    with pytest.raises(RemoteError, match="cannot be reached"):
        asyncio.run(run())

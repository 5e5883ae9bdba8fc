"""Servers of a bus that are several."""

from __future__ import annotations

import asyncio
from pathlib import Path

import nats
import pytest

from somrs.deployment.bus_server import run_bus
from somrs.storage.nats_connection import connect
from tests.support.cable import Cable
from tests.support.hang import HANG_TIME
from tests.support.nats_server import NatsServer
from tests.support.secure_bus import free_port


async def name_of_server(folder: Path, host: str, cluster_port: int) -> str:
    """The name by which the other servers know one that runs with this folder."""
    port = free_port()
    running = asyncio.create_task(run_bus(folder, host, port, cluster_port, [f"127.0.0.1:{cluster_port}"]))
    try:
        async with asyncio.timeout(HANG_TIME):
            client = await nats.connect(f"nats://127.0.0.1:{port}", max_reconnect_attempts=-1, reconnect_time_wait=0.1)
            name = str(client._server_info["server_name"])  # the library has no public way to ask
            await client.close()
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
    return name


def test_servers_that_listen_at_all_addresses_of_their_hosts_are_told_apart_and_known_again(tmp_path: Path) -> None:
    """The servers count their votes by their names, and need more than half of them to store anything."""
    cluster_port = free_port()
    folders = [tmp_path / name for name in ("first", "second", "first")]
    names = [asyncio.run(name_of_server(folder, "0.0.0.0", cluster_port)) for folder in folders]
    assert names[0] == names[2] != names[1]


@pytest.mark.long
def test_a_program_goes_to_another_server_when_the_host_of_its_own_is_lost_without_a_word(tmp_path: Path) -> None:
    async def scenario() -> None:
        with NatsServer(tmp_path) as server:
            cable = Cable(server.port)
            async with cable as port, asyncio.timeout(HANG_TIME):
                client = await connect(f"nats://127.0.0.1:{port},nats://127.0.0.1:{server.port}", dont_randomize=True)
                assert client.connected_url is not None
                assert client.connected_url.port == port
                cable.is_cut = True
                while client.connected_url is None or client.connected_url.port != server.port:
                    await asyncio.sleep(0.05)
                await client.flush()
                await client.close()

    asyncio.run(scenario())


def test_a_server_is_known_by_its_address(tmp_path: Path) -> None:
    cluster_port = free_port()
    assert asyncio.run(name_of_server(tmp_path, "127.0.0.1", cluster_port)) == f"127.0.0.1:{cluster_port}"

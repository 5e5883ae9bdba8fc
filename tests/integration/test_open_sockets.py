"""Connections that say nothing keep no robot from the simulator, nor a device from the symbolic world."""

from __future__ import annotations

import asyncio

import pytest

from somrs.devices.simulator.link.link import OperatorLink, RobotLink
from somrs.devices.symbolic.lines import Hello, encode_line
from somrs.devices.symbolic.server import WorldServer
from somrs.devices.symbolic.world import SymbolicWorld
from somrs.errors import RemoteError
from somrs.ontology.files.loading import load_text
from tests.support.robot_lab import SITE, run, simulator


def test_robots_find_a_place_among_silent_connections_and_none_among_speaking_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOMRS_LIMIT_CONNECTIONS", "3")

    async def test() -> None:
        async with simulator() as server:
            silent_connections = [await asyncio.open_connection(server.host, server.port) for _ in range(20)]
            async with RobotLink(server.host, server.port, "Robot1") as robot:
                assert await silent_connections[0][0].read() == b"", "it gave its place up"
                silent_connections += [await asyncio.open_connection(server.host, server.port) for _ in range(20)]
                async with RobotLink(server.host, server.port, "Robot2"), OperatorLink(server.host, server.port):
                    with pytest.raises(RemoteError, match="serves 3 connections, which is the limit"):
                        async with OperatorLink(server.host, server.port):
                            pass
                    assert (await robot.status()).state
            for _, writer in silent_connections:
                writer.close()

    run(test())


def test_a_device_finds_a_place_in_the_symbolic_world(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOMRS_LIMIT_CONNECTIONS", "2")

    async def test() -> None:
        loaded = load_text(SITE, "site.yaml")
        assert loaded.map is not None
        server = WorldServer(SymbolicWorld(loaded.ontology, loaded.map))
        await server.start()
        silent_connections = [await asyncio.open_connection(server.host, server.port) for _ in range(20)]
        answers = []
        for _ in range(3):
            reader, writer = await asyncio.open_connection(server.host, server.port)
            silent_connections.append((reader, writer))
            writer.write(encode_line(Hello(device="Robot1")))
            answers.append(await reader.readline())
        assert all(b"services" in answer for answer in answers[:2])
        assert b"2 connections, which is the limit" in answers[2]
        await server.stop()
        for _, writer in silent_connections:
            writer.close()

    run(test())

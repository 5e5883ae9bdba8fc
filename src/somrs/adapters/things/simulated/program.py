"""Puts doors and lifts of the simulator behind the session interface, at a broker or as a server."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Mapping, Sequence

import aiomqtt
from aiohttp import web
from msgspec import Struct

from somrs.adapters.brokers import ServerChoice
from somrs.adapters.things.model import Connection
from somrs.adapters.things.mqtt import client_at
from somrs.adapters.things.simulated.controller import PassageController
from somrs.adapters.things.simulated.link_body import link_body
from somrs.adapters.things.simulated.servers import http_application, serve_mqtt

PAUSE = 1.0
"""Seconds after which a broker that is not there is tried again."""


class SimulatedPassage(Struct, frozen=True):
    """A door or a lift: where its session interface is, and the heights of its levels, m."""

    name: str
    connection: Connection
    place: str
    heights: Mapping[str, float]


async def serve_passages(passages: Sequence[SimulatedPassage], simulator: str) -> None:
    """Be the controllers of the passages of the simulator at an address, until it is cancelled."""
    servers: dict[Connection, dict[str, PassageController]] = {}
    async with contextlib.AsyncExitStack() as stack, asyncio.TaskGroup() as tasks:
        for passage in passages:
            body = await stack.enter_async_context(link_body(passage.name, passage.heights, simulator))
            controller = PassageController(body)
            if passage.connection.kind == "mqtt":
                tasks.create_task(serve_broker(passage.connection, passage.place, controller))
            else:
                servers.setdefault(passage.connection, {})[passage.place] = controller
        for server, controllers in servers.items():
            tasks.create_task(_serve_http(server.host, server.port, controllers))


async def serve_broker(broker: Connection, topic: str, controller: PassageController) -> None:
    """Be a passage at a broker, over a connection of its own, until it is cancelled."""
    servers = ServerChoice(broker.servers)
    while True:
        try:
            await serve_mqtt(lambda will: client_at(broker, servers.current, will), topic, controller)
        except* aiomqtt.MqttError:
            servers.lost()
        await asyncio.sleep(PAUSE)


async def _serve_http(host: str, port: int, controllers: Mapping[str, PassageController]) -> None:
    runner = web.AppRunner(http_application(controllers))
    await runner.setup()
    try:
        await web.TCPSite(runner, host, port).start()
        await asyncio.Event().wait()
    finally:
        await runner.cleanup()

"""Puts doors and lifts of the simulator behind the session interface, at a broker or as a server."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Mapping, Sequence

import aiomqtt
from aiohttp import web
from msgspec import Struct

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
    groups: dict[Connection, dict[str, PassageController]] = {}
    async with contextlib.AsyncExitStack() as stack, asyncio.TaskGroup() as tasks:
        for passage in passages:
            body = await stack.enter_async_context(link_body(passage.name, passage.heights, simulator))
            groups.setdefault(passage.connection, {})[passage.place] = PassageController(body)
        for place, controllers in groups.items():
            is_broker = place.kind == "mqtt"
            serving = _serve_broker(place, controllers) if is_broker else _serve_http(place.host, place.port, controllers)
            tasks.create_task(serving)


async def _serve_broker(broker: Connection, controllers: Mapping[str, PassageController]) -> None:
    while True:
        try:
            await serve_mqtt(client_at(broker), controllers)
        except* aiomqtt.MqttError:
            pass
        await asyncio.sleep(PAUSE)


async def _serve_http(host: str, port: int, controllers: Mapping[str, PassageController]) -> None:
    runner = web.AppRunner(http_application(controllers))
    await runner.setup()
    try:
        await web.TCPSite(runner, host, port).start()
        await asyncio.Event().wait()
    finally:
        await runner.cleanup()

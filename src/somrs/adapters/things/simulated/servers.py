"""Puts simulated lifts and doors behind MQTT and HTTP."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Mapping

import aiomqtt
import msgspec
from aiohttp import web

from somrs.adapters.things.session_messages import SessionState
from somrs.adapters.things.simulated.controller import PassageController

STEP = 0.1
"""Seconds between two steps."""


async def move(controllers: Mapping[str, PassageController], speed: float = 1.0) -> None:
    """Let the time of the passages pass, `speed` times as fast as it does, until it is cancelled."""
    while True:
        await asyncio.sleep(STEP / speed)
        for controller in controllers.values():
            controller.body.step(STEP)


def last_will(topic: str) -> aiomqtt.Will:
    """What a broker says of the passage below a topic when its controller is cut off."""
    state = SessionState(doors="closed", mode="out-of-order")
    return aiomqtt.Will(f"{topic}/state", msgspec.json.encode(state), qos=1, retain=True)


async def serve_mqtt(
    connect: Callable[[aiomqtt.Will], aiomqtt.Client], topic: str, controller: PassageController, speed: float = 1.0
) -> None:
    """Be a passage at a broker: TOPIC/request and TOPIC/state, which is retained. It announces its end: by its last will when it is cut
    off, and itself when it is cancelled.

    `connect`: makes a client with this last will, of which a connection has one, and which is not connected yet.
    """
    will = last_will(topic)
    async with connect(will) as client:
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(_publish_state(client, topic, controller, speed))
                await client.subscribe(f"{topic}/request", 0)
                async for message in client.messages:
                    if isinstance(message.payload, bytes):
                        controller.request(message.payload)
        except asyncio.CancelledError:
            with contextlib.suppress(aiomqtt.MqttError):
                await client.publish(will.topic, will.payload, will.qos, will.retain)
            raise


async def _publish_state(client: aiomqtt.Client, topic: str, controller: PassageController, speed: float) -> None:
    published: SessionState | None = None
    while True:
        state = controller.state()
        if state != published:
            published = state
            await client.publish(f"{topic}/state", msgspec.json.encode(state), qos=1, retain=True)
        await asyncio.sleep(STEP / speed)


def http_application(controllers: Mapping[str, PassageController]) -> web.Application:
    """Be the passages of a server, by the paths below which each is: PUT PATH/session, and GET PATH/state."""

    async def put_session(request: web.Request) -> web.Response:
        controllers[request.path.removesuffix("/session")].request(await request.read())
        return web.Response(status=204)

    async def get_state(request: web.Request) -> web.Response:
        state = controllers[request.path.removesuffix("/state")].state()
        return web.Response(body=msgspec.json.encode(state), content_type="application/json")

    application = web.Application()
    for path in controllers:
        application.add_routes([web.put(f"{path}/session", put_session), web.get(f"{path}/state", get_state)])
    return application

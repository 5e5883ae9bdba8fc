"""Puts simulated lifts and doors behind MQTT and HTTP."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

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


async def serve_mqtt(broker: aiomqtt.Client, controllers: Mapping[str, PassageController], speed: float = 1.0) -> None:
    """Be the passages at a broker, by the topics below which each is: TOPIC/request and TOPIC/state, which is retained.

    `broker`: is not connected yet.
    """
    async with broker as client, asyncio.TaskGroup() as group:
        group.create_task(_publish_states(client, controllers, speed))
        await client.subscribe([(f"{topic}/request", 0) for topic in controllers])
        async for message in client.messages:
            topic = str(message.topic).removesuffix("/request")
            if topic in controllers and isinstance(message.payload, bytes):
                controllers[topic].request(message.payload)


async def _publish_states(client: aiomqtt.Client, controllers: Mapping[str, PassageController], speed: float) -> None:
    published: dict[str, SessionState] = {}
    while True:
        for topic, controller in controllers.items():
            state = controller.state()
            if state != published.get(topic):
                published[topic] = state
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

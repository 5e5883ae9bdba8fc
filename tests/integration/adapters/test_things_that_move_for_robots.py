"""Doors and lifts among things: traffic opens them and rides, over MQTT and HTTP."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from pathlib import Path

import aiomqtt
import pytest
from aiohttp import web

from somrs.adapters.things.adapter import device_for
from somrs.adapters.things.hub import Hub
from somrs.adapters.things.mapping_file import read_mapping
from somrs.adapters.things.model import Connection
from somrs.adapters.things.simulated.body import KinematicPassage
from somrs.adapters.things.simulated.controller import PassageController
from somrs.adapters.things.simulated.program import serve_broker
from somrs.adapters.things.simulated.servers import http_application, move, serve_mqtt
from somrs.devices.passage import PassageDevice
from somrs.ontology.files.loading import upper
from somrs.ports import listen_at
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.service_manager.sdk.map_reader import MapReader
from somrs.traffic.passage_call import PassageCall, PassageStatus
from tests.support.cable import Cable
from tests.support.hang import HANG_TIME
from tests.support.mqtt_broker import MqttBroker
from tests.support.simulated_tower import HEIGHT, tower
from tests.support.simulator_room import box
from tests.support.virtual_devices import make_ask

SPEED = 10.0

REPOSITORY = Repository(
    "http://here/repository",
    Contents(ontology=upper(), map=tower(extra_objects=[box("Door1", "AutomaticDoor", (4, 3, 0), (0.1, 1.2, 2.1))])),
)
STOREYS = [fact.arguments[1] for fact in tower().facts("stopsAt")]
"""The storeys of the tower at which its lift stops, from below."""

BY_TOPICS = """
connections: {{house: {{url: "{url}"}}}}
things:
  Lift1: {{type: Lift, session: {{topic: lifts/1, levels: {levels}}}}}
  Door1: {{type: AutomaticDoor, session: {{topic: doors/1}}}}
"""
BY_PATHS = """
connections: {{building: {{url: "{url}"}}}}
things:
  Lift1: {{type: Lift, session: {{path: /lifts/1, poll: 50 ms, levels: {levels}}}}}
"""
BY_MESSAGES = """
connections: {{house: {{url: "{url}"}}}}
things:
  Door1:
    type: AutomaticDoor
    attributes: {{Open: {{topic: door/state}}}}
    door: {{open: [{{topic: door/set, payload: open}}], close: [{{topic: door/set, payload: close}}]}}
"""


def lift() -> PassageController:
    levels = {str(number): HEIGHT * number for number in range(len(STOREYS))}
    return PassageController(KinematicPassage(levels))


def door() -> PassageController:
    return PassageController(KinematicPassage({}))


def served(broker: MqttBroker, topic: str, controller: PassageController) -> asyncio.Task[None]:
    """A passage at a broker."""
    return asyncio.create_task(serve_mqtt(lambda will: aiomqtt.Client("127.0.0.1", broker.mqtt_port, will=will), topic, controller, SPEED))


@contextlib.asynccontextmanager
async def passages(folder: Path, mapping: str, url: str) -> AsyncIterator[dict[str, PassageDevice]]:
    """The devices of a mapping, which have the tower as their map."""
    levels = "{" + ", ".join(f"{storey}: '{number}'" for number, storey in enumerate(STOREYS)) + "}"
    (folder / "passages.yaml").write_text(mapping.format(url=url, levels=levels))
    loaded, hub = read_mapping(folder / "passages.yaml"), Hub()
    connectors = [hub.connect(connection) for connection in loaded.connections.values()]
    devices: dict[str, PassageDevice] = {}
    running = [asyncio.create_task(connector.run()) for connector in connectors]
    for thing in loaded.things:
        hub.add(thing, loaded.ontology)
        device = device_for(thing, hub)
        assert isinstance(device, PassageDevice)
        devices[thing.name] = device
        device.map = MapReader(make_ask(REPOSITORY, lambda: 0.0))
        await device.open()
    try:
        yield devices
    finally:
        for device in devices.values():
            await device.close()
        for task in running:
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)


async def until(device: PassageDevice, status: PassageStatus) -> None:
    while device.current_status != status:
        await asyncio.sleep(0.02)


@contextlib.asynccontextmanager
async def background(*work: asyncio.Task[None]) -> AsyncIterator[None]:
    try:
        yield
    finally:
        for task in work:
            task.cancel()
        await asyncio.gather(*work, return_exceptions=True)


async def ride(device: PassageDevice, controller: PassageController) -> None:
    """Call a lift to the lowest floor, and to the next, and release it."""
    await until(device, PassageStatus(level=0.0))
    await device.follow(PassageCall(level=0.0, destination=HEIGHT))
    assert controller.state().doors == "open"
    await device.follow(PassageCall(level=HEIGHT))
    assert (controller.state().level, controller.state().doors) == ("1", "open")
    await until(device, PassageStatus(level=HEIGHT))
    await device.follow(None)
    while controller.session is not None:
        await asyncio.sleep(0.02)


def test_a_lift_and_a_door_at_a_broker(tmp_path: Path) -> None:
    async def test() -> None:
        controllers = {"lifts/1": lift(), "doors/1": door()}
        with MqttBroker(tmp_path) as broker:
            serving = [served(broker, topic, controller) for topic, controller in controllers.items()]
            async with (
                background(*serving, asyncio.create_task(move(controllers, SPEED))),
                passages(tmp_path, BY_TOPICS, broker.url) as devices,
            ):
                await ride(devices["Lift1"], controllers["lifts/1"])
                await devices["Door1"].follow(PassageCall())
                assert controllers["doors/1"].state().doors == "open"
                await devices["Door1"].follow(None)
                controllers["lifts/1"].mode = "out-of-order"
                await until(devices["Lift1"], PassageStatus(level=HEIGHT, working=False))

    asyncio.run(asyncio.wait_for(test(), HANG_TIME))


def test_a_lift_with_a_server(tmp_path: Path) -> None:
    async def test() -> None:
        controllers = {"/lifts/1": lift()}
        runner = web.AppRunner(http_application(controllers))
        await runner.setup()
        with listen_at("127.0.0.1", 0) as socket:
            await web.SockSite(runner, socket).start()
            url = f"http://127.0.0.1:{socket.getsockname()[1]}"
            moving = asyncio.create_task(move(controllers, SPEED))
            async with background(moving), passages(tmp_path, BY_PATHS, url) as devices:
                await ride(devices["Lift1"], controllers["/lifts/1"])
                await runner.cleanup()
                await until(devices["Lift1"], PassageStatus(working=False))

    asyncio.run(asyncio.wait_for(test(), HANG_TIME))


def test_a_lift_is_had_again_when_the_broker_and_the_controller_were_started_again(tmp_path: Path) -> None:
    async def test() -> None:
        with MqttBroker(tmp_path) as broker:
            controllers = {"lifts/1": lift()}
            serving = served(broker, "lifts/1", controllers["lifts/1"])
            async with background(asyncio.create_task(move(controllers, SPEED))), passages(tmp_path, BY_TOPICS, broker.url) as devices:
                async with background(serving):
                    await devices["Lift1"].follow(PassageCall(level=HEIGHT))
                broker.kill()
                broker.start()
                controllers["lifts/1"].session = None  # it has forgotten
                async with background(served(broker, "lifts/1", controllers["lifts/1"])):
                    while controllers["lifts/1"].session != "somrs-Lift1":
                        await asyncio.sleep(0.02)

    asyncio.run(asyncio.wait_for(test(), HANG_TIME))


@pytest.mark.parametrize("is_killed", [True, False])
def test_a_lift_is_out_of_order_when_its_controller_has_ended(tmp_path: Path, is_killed: bool) -> None:
    async def test() -> None:
        with MqttBroker(tmp_path) as broker:
            cable = Cable(broker.mqtt_port)
            async with contextlib.AsyncExitStack() as stack, passages(tmp_path, BY_TOPICS, broker.url) as devices:
                at_cable = Connection(name="broker", scheme="mqtt", host="127.0.0.1", port=await stack.enter_async_context(cable))
                serving = [
                    asyncio.create_task(serve_broker(at_cable, topic, control))
                    for topic, control in (("lifts/1", lift()), ("doors/1", door()))
                ]
                async with background(*serving):
                    await until(devices["Lift1"], PassageStatus(level=0.0))
                    await until(devices["Door1"], PassageStatus())
                    if is_killed:
                        await stack.aclose()
                        await until(devices["Door1"], PassageStatus(working=False))
                await until(devices["Lift1"], PassageStatus(working=False))
                await until(devices["Door1"], PassageStatus(working=False))

    asyncio.run(asyncio.wait_for(test(), HANG_TIME))


@pytest.mark.parametrize("says_open_late", [False, True])
def test_a_door_that_messages_open_and_close(tmp_path: Path, says_open_late: bool) -> None:
    async def test() -> None:
        with MqttBroker(tmp_path) as broker:
            async with (
                aiomqtt.Client("127.0.0.1", broker.mqtt_port) as client,
                passages(tmp_path, BY_MESSAGES, broker.url) as devices,
            ):
                await client.subscribe("door/set")
                await client.publish("door/state", "closed", qos=1, retain=True)
                await until(devices["Door1"], PassageStatus())
                opening = asyncio.create_task(devices["Door1"].follow(PassageCall()))
                assert (await anext(aiter(client.messages))).payload == b"open"
                if says_open_late:
                    await asyncio.sleep(0.2)
                    assert not opening.done()
                await client.publish("door/state", "open", qos=1, retain=True)
                await opening
                await devices["Door1"].follow(None)
                assert (await anext(aiter(client.messages))).payload == b"close"

    asyncio.run(asyncio.wait_for(test(), HANG_TIME))

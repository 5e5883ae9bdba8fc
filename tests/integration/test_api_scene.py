"""The scene that the windows draw: what the map says there is, and where it is while it moves, with the real simulator behind it."""

from __future__ import annotations

import asyncio
import math
import struct
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest

from somrs.api.bodies import Body, scene_of
from somrs.api.context import Context
from somrs.api.listener import Listener
from somrs.api.poses import PoseFeed
from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.client.hub import Hub
from somrs.devices.simulator.link.link import RobotLink
from somrs.devices.simulator.server.server import Server
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, ValueSet
from somrs.ontology.types import Ontology
from tests.support.hang import HANG_TIME
from tests.support.robot_lab import SITE, run, simulator, site


def bodies(text: str = SITE) -> dict[str, Body]:
    loaded, map = site(text)
    return {body.name: body for body in scene_of(map, 1, loaded.ontology, map.objects.values()).bodies}


def test_the_scene_has_all_that_takes_up_space() -> None:
    scene_bodies = bodies()
    assert {name: body.kind for name, body in scene_bodies.items()} == {
        "Floor1": "floor",
        "Wall1": "wall",
        "Table1": "furniture",
        "Platform1": "furniture",
        "Jar1": "thing",
        "Anvil1": "thing",
        "Robot1": "robot",
        "Robot2": "robot",
    }
    jar = scene_bodies["Jar1"]
    assert (jar.x, jar.y, jar.z, jar.radius, jar.height) == (1.15, 4, 0.7, 0.04, 0.14), "its form is its type's"
    assert jar.placement is not None
    assert (jar.placement.relation, jar.placement.object) == ("isOn", "Table1")
    assert scene_bodies["Robot1"].arm is not None
    assert scene_bodies["Floor1"].storey == "Storey1"


def test_a_scene_says_what_cannot_be_drawn_and_has_the_rest() -> None:
    loaded, map = site()
    broken = map.changed([ValueSet("Table1", "Shape.Width", 0.0), ValueSet("Table1", "Shape.Depth", 0.0)])
    scene = scene_of(broken, 1, loaded.ontology, broken.objects.values())
    assert "Table1" not in {body.name for body in scene.bodies}
    assert "Table1" in scene.problems[0]


def test_what_was_put_elsewhere_and_not_measured_is_drawn_there() -> None:
    loaded, map = site()
    moved = map.changed([FactRemoved(Fact("isOn", ("Jar1", "Table1"))), FactAdded(Fact("isOn", ("Jar1", "Platform1")))])
    (jar,) = scene_of(moved, 1, loaded.ontology, [moved.objects["Jar1"]]).bodies
    assert (jar.x, jar.y, jar.z) == (6.5, 4, 0.3)
    held = map.changed([FactRemoved(Fact("isOn", ("Jar1", "Table1"))), FactAdded(Fact("isHeldBy", ("Jar1", "Robot1")))])
    (jar,) = scene_of(held, 1, loaded.ontology, [held.objects["Jar1"]]).bodies
    assert (jar.x, jar.y, jar.z) == (2, 1.5, 0.25)


class Viewer:
    """Reads what is sent, as a page would."""

    def __init__(self, feed: PoseFeed) -> None:
        self._feed = feed
        self._movers: list[dict[str, Any]] = []
        self._table = 0
        self._last_tick: int | None = None
        self.poses: dict[str, tuple[float, ...]] = {}
        self.robots: dict[str, Any] = {}
        self.alive: bool | None = None
        self.frames: list[int] = []
        """How many movers each had."""

    async def look(self) -> None:
        self._last_tick, messages = await self._feed.wait_for_tick(self._last_tick)
        for message in messages:
            self._read_frame(message) if isinstance(message, bytes) else self._read(message)

    def _read(self, text: str) -> None:
        news = msgspec.json.decode(text)
        if "movers" in news:
            self._movers, self._table, self.poses, self.robots = news["movers"], news["table"], {}, {}
        self.robots.update(news.get("robots", {}))
        self.alive = news.get("alive", self.alive)

    def _read_frame(self, frame: bytes) -> None:
        _, _, table, count = struct.unpack_from("<ddII", frame)
        assert table == self._table
        mover_indices = struct.unpack_from(f"<{count}I", frame, 24)
        offset = 24 + 4 * count
        for i in mover_indices:
            numbers = self._movers[i]["numbers"]
            self.poses[self._movers[i]["name"]] = struct.unpack_from(f"<{numbers}f", frame, offset)
            offset += 4 * numbers
        assert offset == len(frame)
        self.frames.append(count)

    async def wait_until(self, condition: Callable[[], object]) -> None:
        async with asyncio.timeout(HANG_TIME):
            while not condition():
                await self.look()


@asynccontextmanager
async def context(map: Map, ontology: Ontology, server: Server | None = None) -> AsyncIterator[Context]:
    """The context of the API, as far as scenes need it: the map as it was read, and the simulator."""
    simulator_address = None if server is None else f"{server.host}:{server.port}"
    addresses = Addresses(repository="http://r/r", registry="http://r/s", task_manager="http://r/t", simulator=simulator_address)
    listener = Listener("http://d/d", addresses, Hub())
    listener.replica.map, listener.replica.ontology = map, ontology
    async with Client(addresses) as client:
        yield Context(addresses=addresses, data=Path(), client=client, listener=listener, hub=Hub())


def test_all_viewers_see_the_robot_move() -> None:
    async def test() -> None:
        loaded, map = site()
        async with simulator(speed=10) as server, context(map, loaded.ontology, server) as api_context:
            feed = PoseFeed(api_context)
            first_viewer, second_viewer = Viewer(feed), Viewer(feed)
            with feed.viewing(), feed.viewing():
                await first_viewer.wait_until(lambda: first_viewer.poses)
                assert set(first_viewer.poses) == {"Robot1", "Robot2", "Jar1", "Anvil1"}
                async with RobotLink(server.host, server.port, "Robot1") as robot:
                    grip_task = asyncio.create_task(robot.grip("Jar1"))
                    await first_viewer.wait_until(lambda: first_viewer.robots["Robot1"].get("holding") == "Jar1")
                    await grip_task
                assert sorted(first_viewer.frames)[len(first_viewer.frames) // 2] <= 2, "what stands still is not sent again"
                await second_viewer.wait_until(lambda: second_viewer.poses)
                await first_viewer.look()
                assert second_viewer.robots["Robot1"]["holding"] == "Jar1", "who comes late is told all"
                assert math.dist(second_viewer.poses["Jar1"][:3], first_viewer.poses["Jar1"][:3]) < 0.01

    run(test())


def test_who_skipped_ticks_is_sent_everything() -> None:
    async def test() -> None:
        loaded, map = site()
        async with simulator(speed=10) as server, context(map, loaded.ontology, server) as api_context:
            feed = PoseFeed(api_context)
            quick, slow = Viewer(feed), Viewer(feed)
            with feed.viewing(), feed.viewing():
                await slow.wait_until(lambda: slow.poses)
                async with RobotLink(server.host, server.port, "Robot1") as robot:
                    drive_task = asyncio.create_task(robot.drive_to(4, 4))
                    await quick.wait_until(lambda: len(quick.frames) > 10)
                    await slow.look()
                    assert slow.poses == quick.poses
                    await robot.stop()
                    await asyncio.wait({drive_task})

    run(test())


def test_a_simulator_that_comes_back_is_followed_again() -> None:
    async def test() -> None:
        loaded, map = site()
        async with simulator() as server, context(map, loaded.ontology, server) as api_context:
            feed = PoseFeed(api_context)
            viewer = Viewer(feed)
            with feed.viewing():
                await viewer.wait_until(lambda: viewer.poses)
                await server.stop()
                await viewer.wait_until(lambda: viewer.alive is False)
                restarted_server = Server(server.simulation, port=server.port)
                await restarted_server.start()
                await viewer.wait_until(lambda: viewer.alive)
                assert set(viewer.poses) == {"Robot1", "Robot2", "Jar1", "Anvil1"}
                await restarted_server.stop()

    run(test())


def test_the_simulator_is_followed_once_and_only_while_somebody_looks() -> None:
    async def test() -> None:
        loaded, map = site()
        async with simulator() as server, context(map, loaded.ontology, server) as api_context:
            feed = PoseFeed(api_context)
            for _ in range(2):
                viewers = [Viewer(feed) for _ in range(3)]
                with feed.viewing(), feed.viewing(), feed.viewing():
                    for viewer in viewers:
                        await viewer.wait_until(lambda viewer=viewer: viewer.poses)  # type: ignore[misc]
                    assert len(server._connections.followers) == 1
                async with asyncio.timeout(HANG_TIME):
                    while server._connections.followers:
                        await asyncio.sleep(0.01)

    run(test())


@pytest.mark.parametrize("relation", ["isOn", "isHeldBy"])
def test_without_a_simulator_things_move_as_the_map_says(relation: str) -> None:
    async def test() -> None:
        loaded, map = site()
        async with context(map, loaded.ontology) as api_context:
            feed = PoseFeed(api_context)
            viewer = Viewer(feed)

            def change(*changes: Change) -> None:
                api_context.listener.replica.map = api_context.map.changed(changes)
                api_context.hub.publish("map")

            with feed.viewing():
                await viewer.wait_until(lambda: viewer.poses)
                assert viewer.poses["Robot1"][:2] == (2, 1.5)
                change(ValueSet("Robot1", "PositionX", 3.0))
                await viewer.wait_until(lambda: viewer.poses["Robot1"][0] == 3)
                assert viewer.frames[1:] == [1]
                target = {"isOn": "Platform1", "isHeldBy": "Robot1"}[relation]
                change(FactRemoved(Fact("isOn", ("Jar1", "Table1"))), FactAdded(Fact(relation, ("Jar1", target))))
                await viewer.wait_until(lambda: viewer.poses["Jar1"][0] == (6.5 if relation == "isOn" else 3))
                assert viewer.robots["Robot1"].get("holding") == (None if relation == "isOn" else "Jar1")

    run(test())

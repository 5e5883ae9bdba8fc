"""What simulated cameras notice by themselves, and what they leave alone."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from somrs.devices.simulator.drivers.watching import WatchingDevice
from somrs.errors import RemoteError
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import UNKNOWN, Value
from somrs.protocol.messages.bodies import Body
from somrs.service_manager.sdk.map_reader import MapReader
from tests.support.observation_lab import Lab, lab

PLATFORM = (10.5, 4.0, 0.3)


def watch(use: Callable[[Lab, WatchingDevice], Awaitable[None]], name: str = "Camera1") -> None:
    async def run() -> None:
        async with lab() as rooms:
            device = await rooms.open(name)
            assert isinstance(device, WatchingDevice)
            await use(rooms, device)

    asyncio.run(run())


async def look(device: WatchingDevice, times: int = 2) -> None:
    for _ in range(times):
        await device.watch()


def map_of(rooms: Lab) -> Map:
    return rooms.repository.contents.map


def add_jar(rooms: Lab, x: float, y: float, z: float) -> None:
    """A jar comes to the world without the map's knowing."""
    values: dict[str, Value] = {"PositionX": x, "PositionY": y, "PositionZ": z, "Color": "Green"}
    rooms.server.simulation.add(Object(name="Hidden", type="Jar", values=values))


def position(map: Map, name: str) -> tuple[float, float]:
    values = map.objects[name].values
    x, y = values["PositionX"], values["PositionY"]
    assert isinstance(x, float)
    assert isinstance(y, float)
    return x, y


def test_what_nobody_knew_comes_to_the_map_with_who_saw_it() -> None:
    async def use(rooms: Lab, camera: WatchingDevice) -> None:
        add_jar(rooms, *PLATFORM)
        await look(camera, 1)
        assert rooms.repository.contents.version == 0, "one look may be wrong"
        await look(camera)
        jar = map_of(rooms).objects["Jar002"]
        assert (jar.type, jar.values["Color"]) == ("Jar", "Green")
        assert position(map_of(rooms), "Jar002") == pytest.approx(PLATFORM[:2], abs=0.05)
        assert map_of(rooms).has_fact("isOn", ("Jar002", "Platform1"))
        assert rooms.repository.contents.provenance.discoveries["Jar002"].author == "Camera1"
        version = rooms.repository.contents.version
        await look(camera, 3)
        assert rooms.repository.contents.version == version, "it is known now"

    watch(use)


def test_what_was_moved_in_view_is_where_it_is_seen() -> None:
    async def use(rooms: Lab, camera: WatchingDevice) -> None:
        add_jar(rooms, *PLATFORM)
        await look(camera)
        assert "Jar002" in map_of(rooms).objects
        await rooms.operator.move("Hidden", 10.7, 4.2, 0.3)
        await look(camera)
        assert position(map_of(rooms), "Jar002") == pytest.approx((10.7, 4.2), abs=0.05)
        await rooms.operator.move("Hidden", 10.5, 5.0, 0.0)
        await look(camera)
        assert position(map_of(rooms), "Jar002") == pytest.approx((10.5, 5.0), abs=0.05), "it is missing there, and so it is this one"
        assert "Jar003" not in map_of(rooms).objects

    watch(use)


def test_what_is_not_where_it_should_be_in_full_view_is_missing() -> None:
    async def use(rooms: Lab, camera: WatchingDevice) -> None:
        add_jar(rooms, *PLATFORM)
        await look(camera)
        await rooms.operator.move("Hidden", 1.0, 5.0, 0.0)
        await look(camera, 1)
        assert map_of(rooms).objects["Jar002"].values.get(UNKNOWN) is not True
        await look(camera, 1)
        assert map_of(rooms).objects["Jar002"].values.get(UNKNOWN) is True
        assert not map_of(rooms).has_fact("isOn", ("Jar002", "Platform1"))
        assert map_of(rooms).has_fact("isOn", ("Jar1", "Table1")), "the camera does not see that table"
        await rooms.operator.move("Hidden", *PLATFORM)
        await look(camera)
        assert map_of(rooms).objects["Jar002"].values.get(UNKNOWN) is not True
        assert map_of(rooms).has_fact("isOn", ("Jar002", "Platform1"))

    watch(use)


def test_what_a_robot_may_be_handling_is_its_own_affair() -> None:
    async def use(rooms: Lab, camera: WatchingDevice) -> None:
        add_jar(rooms, 9.0, 4.9, 0.0)
        await look(camera, 3)
        assert rooms.repository.contents.version == 0

    watch(use)


def test_what_hides_a_place_does_not_make_a_thing_missing() -> None:
    async def use(rooms: Lab, camera: WatchingDevice) -> None:
        add_jar(rooms, *PLATFORM)
        await look(camera)
        assert "Jar002" in map_of(rooms).objects
        await rooms.operator.move("Hidden", 1.0, 5.0, 0.0)
        screen = {"PositionX": 10.9, "PositionY": 4.5, "PositionZ": 0.0, "RotationZ": 0.9}
        shape: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": 0.1, "Shape.Depth": 1.6, "Shape.Height": 2.2}
        rooms.server.simulation.add(Object(name="Screen1", type="Obstacle", values={**screen, **shape}))
        await look(camera, 3)
        assert map_of(rooms).objects["Jar002"].values.get(UNKNOWN) is not True

    watch(use)


def test_an_idle_patrol_robot_watches_too() -> None:
    async def use(rooms: Lab, robot: WatchingDevice) -> None:
        add_jar(rooms, 10.5, 5.0, 0.0)
        await look(robot, 3)
        assert map_of(rooms).objects["Jar002"].values["Color"] == "Green"

    watch(use, "Patrol1")


def test_the_log_says_once_that_the_map_cannot_be_read_and_once_that_it_can_again(caplog: pytest.LogCaptureFixture) -> None:
    async def use(rooms: Lab, camera: WatchingDevice) -> None:
        reader = camera.map

        async def no_answer(body: Body) -> Body:
            raise RemoteError("the Repository does not answer")

        for _ in range(2):
            await look(camera)
            camera.map = MapReader(no_answer)
            await look(camera, 4)
            camera.map = reader
            await look(camera)

    watch(use)
    outage = [
        "Camera1 cannot compare what it sees with the map: the Repository does not answer",
        "Camera1 can compare what it sees with the map again",
    ]
    assert [record.getMessage() for record in caplog.records if "compare" in record.getMessage()] == outage * 2

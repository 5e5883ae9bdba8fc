"""A Pioneer robot as a device, over a real line: what its services and traffic tell it, and what it says."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from somrs.adapters.arcos.robot import ArcosRobot
from somrs.adapters.arcos.settings import RobotSettings
from somrs.adapters.arcos.simulated.body import Place, PlaneBody
from somrs.adapters.arcos.simulated.firmware import Firmware
from somrs.adapters.arcos.simulated.server import SimulatedRobot, serving_tcp
from somrs.adapters.arcos.stored_reckoning import load_reckoning
from somrs.devices.road_robot import RobotFailed
from somrs.service_manager.sdk.map_reader import MapReader
from tests.integration.adapters.test_arcos_lines import run, wait_until
from tests.support.pioneers import way
from tests.support.robot_lab import repository
from tests.support.virtual_devices import make_ask


class RecordingRobot(ArcosRobot, replaces=("passed", "gave_up", "broken")):
    """Notes what it tells traffic."""

    def __init__(self, settings: RobotSettings) -> None:
        super().__init__("Robot1", settings)
        self.notes: list[str] = []

    def passed(self, number: int) -> None:
        self.notes.append(f"passed {number}")
        super().passed(number)

    def gave_up(self, description: str) -> None:
        self.notes.append(description)
        super().gave_up(description)

    def broken(self, reason: str | None) -> None:
        self.notes.append(f"broken: {reason}")
        super().broken(reason)


@contextlib.asynccontextmanager
async def robot(
    folder: Path, *, gripper: bool = True, body: PlaneBody | None = None
) -> AsyncIterator[tuple[RecordingRobot, PlaneBody, SimulatedRobot]]:
    """Robot1 of the laboratory, at (2, 1.5). Jar1 is at (1.15, 4)."""
    body = body or PlaneBody(Place(x=2.0, y=1.5, yaw=0.0))
    simulated = SimulatedRobot(Firmware(body, watchdog=0.5, gripper=gripper))
    async with serving_tcp(simulated) as port:
        device = RecordingRobot(RobotSettings(port=port))
        device.data = folder
        device.map = MapReader(make_ask(repository(), lambda: 0.0))
        await device.open()
        try:
            yield device, body, simulated
        finally:
            await device.close()


def test_a_robot_begins_where_the_map_has_it_and_follows_ways(tmp_path: Path) -> None:
    async def test() -> None:
        async with robot(tmp_path) as (device, body, _):
            await wait_until(lambda: device.road.state is not None)
            state = device.road.state
            assert state is not None
            assert (state.x, state.y) == pytest.approx((2.0, 1.5), abs=0.01)
            await device.follow(way((2.0, 1.5), (2.4, 1.5)))
            await wait_until(lambda: "passed 2" in device.notes)
            assert device._line is not None
            stored = load_reckoning(tmp_path / "arcos" / "Robot1.json")
            assert stored is not None
            assert stored.reckoning == device._line.driver.reckoning, "its program may die at any moment"
            await device.halt()
            assert math.dist((body.place.x, body.place.y), (2.4, 1.5)) < 0.05
            assert device.battery is not None
        async with robot(tmp_path, body=body) as (device, _, _):  # with a controller that has been switched off and on
            await wait_until(lambda: device.road.state is not None)
            state = device.road.state
            assert state is not None
            assert math.dist((body.place.x, body.place.y), (state.x, state.y)) < 0.05

    run(test())


@pytest.mark.parametrize("content", [b"", b"{", b'{"pose": 3}'])
def test_a_damaged_file_is_no_pose(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "Robot1.json"
    file.write_bytes(content)
    assert load_reckoning(file) is None


@pytest.mark.long
def test_a_robot_picks_what_is_before_it_and_drops_it(tmp_path: Path) -> None:
    async def test() -> None:
        async with robot(tmp_path) as (device, body, _):
            yaw = math.atan2(4.0 - 1.5, 1.15 - 2.0)
            distance = math.dist((2.0, 1.5), (1.15, 4.0))
            body.thing = (2.0 + 0.5 * math.cos(yaw), 1.5 + 0.5 * math.sin(yaw))
            await device.pick("Jar1", "Table1")
            assert device.holding == "Jar1"
            assert body.has_thing
            assert distance > 2.0, "the jar is nearer than the map has it"
            assert math.dist((body.place.x, body.place.y), (2.0, 1.5)) < 0.06
            place = body.place
            device.spot = place.x + 0.5 * math.cos(place.yaw), place.y + 0.5 * math.sin(place.yaw)
            await device.drop("Jar1", "Table2")
            assert device.holding is None
            assert body.thing is not None
            assert math.dist(body.thing, device.spot) < 0.03
            assert math.dist(body.thing, (body.place.x, body.place.y)) > 0.35 + 0.08, "it has left the jar"

    run(test())


@pytest.mark.long
def test_a_robot_puts_down_what_it_must_not_keep_and_leaves_it(tmp_path: Path) -> None:
    async def test() -> None:
        body = PlaneBody(Place(x=2.0, y=1.5, yaw=0.0))
        body.is_holding = True
        async with robot(tmp_path, body=body) as (device, _, _):
            x, y, _z, _support = await device.put_down("Jar1")
            assert body.thing is not None
            assert math.dist(body.thing, (x, y)) < 0.03
            assert body.place.x < 2.0 - 0.08

    run(test())


def test_a_program_that_is_started_anew_knows_what_its_robot_holds(tmp_path: Path) -> None:
    async def test() -> None:
        body = PlaneBody(Place(x=2.0, y=1.5, yaw=0.0))
        body.is_holding = True
        async with robot(tmp_path, body=body) as (device, _, _):
            assert device.holding is None, "nobody has told it"
            with pytest.raises(RobotFailed, match="between the paddles of Robot1 that nobody knows"):
                await device.pick("Jar1", "Table1")
            device._road_link.gripper.hold("Jar1", "Table1")
        async with robot(tmp_path, body=body) as (device, _, _):
            assert device.holding == "Jar1"
            body.is_holding = False
        async with robot(tmp_path, body=body) as (device, _, _):
            assert device.holding is None, "somebody has taken it out"

    run(test())


def test_a_robot_without_gripper_says_so(tmp_path: Path) -> None:
    async def test() -> None:
        async with robot(tmp_path, gripper=False) as (device, _, _):
            assert set(device.services()) == {"move_to"}, "nobody makes a contract with it to carry something"
            with pytest.raises(RobotFailed, match="no gripper"):
                await device.pick("Jar1", "Table1")

    run(test())


def test_work_that_is_interrupted_ends_and_the_robot_stands(tmp_path: Path) -> None:
    async def test() -> None:
        async with robot(tmp_path) as (device, _, simulated):
            picking = asyncio.create_task(device.pick("Jar1", "Table1"))
            await asyncio.sleep(1.0)
            picking.cancel()
            await asyncio.wait({picking})
            await device.interrupt()
            assert max(map(abs, simulated.firmware.velocity)) < 2

    run(test())


def test_a_pressed_stop_button_breaks_the_robot(tmp_path: Path) -> None:
    async def test() -> None:
        async with robot(tmp_path) as (device, _, simulated):
            simulated.firmware.stop_button = True
            await wait_until(lambda: device.notes)
            assert device.notes == ["broken: its stop button is pressed"]

    run(test())

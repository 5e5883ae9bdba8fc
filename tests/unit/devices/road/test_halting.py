"""Robots that are told to stand still follow no way that was meant for what they did before."""

from __future__ import annotations

import asyncio
from functools import partial
from pathlib import Path

import pytest

from somrs.devices.simulator.link.connection import RobotGaveUp
from tests.support.road_lab import LabRobot, RoadLab, in_lab, in_virtual_time


@in_lab
async def test_a_robot_that_is_being_stopped_drives_no_further_than_it_keeps(lab: RoadLab, robot: LabRobot) -> None:
    """Seen with vehicles that were cut off from their broker: what traffic grants while they are halted was followed afterwards."""

    robot.stopping = 3.0
    approaching = asyncio.create_task(robot.link.approach("Platform1"))
    await asyncio.sleep(2.0)
    robot.go_away()
    with pytest.raises(RobotGaveUp, match="cannot be reached"):
        await approaching
    await asyncio.sleep(8.0)
    robot.return_back()
    await asyncio.sleep(30.0)
    building = await robot.road.building()
    (place,) = lab.held("Robot1")
    assert (robot.body.x, robot.body.y) == pytest.approx(building.point(place), abs=0.05)


@in_lab
async def test_a_robot_that_cannot_drive_says_why(lab: RoadLab, robot: LabRobot) -> None:
    trip = asyncio.create_task(robot.link.approach("Jar1"))
    await asyncio.sleep(1)
    await robot.halt()  # somebody turns the key
    robot.broken("its key switch is at MANUAL")
    with pytest.raises(RobotGaveUp, match="Robot1 cannot drive: its key switch is at MANUAL"):
        await trip
    assert (await robot.link.status()).state.trouble == "Robot1 cannot drive: its key switch is at MANUAL"
    robot.broken(None)
    await robot.link.approach("Jar1")
    assert (await robot.link.status()).state.trouble is None


def test_a_robot_that_does_not_take_part_in_traffic_yet_says_so(tmp_path: Path) -> None:
    """Seen after its program was killed while it dropped something: the stop of its work ended with a stack trace."""

    async def test() -> None:
        robot = RoadLab(tmp_path).robots["Robot1"]
        robot.say()
        robot.holding = "Jar1"
        for command in (robot.link.put_down_object, partial(robot.link.approach, "Jar1")):
            with pytest.raises(RobotGaveUp, match="Robot1 does not take part in traffic yet"):
                await command()

    in_virtual_time(test())


@in_lab
async def test_a_robot_that_goes_on_with_what_it_is_to_end_holds_nobody_up(lab: RoadLab, robot: LabRobot) -> None:
    """Seen with a VDA 5050 vehicle that ignored `cancelOrder` amid an action: whoever stopped it waited for ever."""

    robot.body.handling = 1000.0
    gripping = asyncio.create_task(robot.link.grip("Jar1"))
    await asyncio.sleep(60.0)
    stopping = asyncio.create_task(robot.link.stop())
    await asyncio.sleep(60.0)
    assert not stopping.done()
    robot.heard(False)  # it is as good as that
    await asyncio.wait({gripping, stopping}, timeout=1.0)
    assert gripping.done()
    assert stopping.done()
    with pytest.raises(RobotGaveUp, match="cannot be reached"):
        await gripping
    robot.body.handling = 1.0
    robot.return_back()
    await robot.link.approach("Jar1")
    assert robot.holding is None

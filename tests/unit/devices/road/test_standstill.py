"""A robot that may drive, and stands: people are told so, and nobody takes it for broken."""

from __future__ import annotations

import asyncio

import pytest

from somrs.devices.road.standstill import Standstill
from tests.support.road_lab import LabRobot, RoadLab, in_lab


def test_how_long_it_stands_is_said_in_steps_until_it_drives() -> None:
    standstill = Standstill("Robot1")
    remarks = []
    for now in (0.0, 10.0, 21.0, 61.0, 300.0):
        standstill.update(may_drive=True, rest_time=-5.0, now=now)
        remarks.append(standstill.remark)
    words = [f"has not moved for {text}, although it may drive on" for text in ("20 seconds", "a minute", "5 minutes")]
    assert remarks == [None, None, *words]
    standstill.update(may_drive=True, rest_time=299.0, now=301.0)
    assert standstill.remark is None


def test_who_is_not_to_drive_may_stand() -> None:
    standstill = Standstill("Robot1")
    for now, may_drive in ((0.0, True), (30.0, False), (100.0, True), (110.0, True)):
        standstill.update(may_drive=may_drive, rest_time=-5.0, now=now)
        assert standstill.remark is None


@in_lab
async def test_a_robot_that_takes_its_way_and_does_not_move_is_told_of(
    lab: RoadLab, robot: LabRobot, caplog: pytest.LogCaptureFixture
) -> None:
    """Seen with a goal that Nav2 had accepted: the task drove for a minute without a word."""
    robot.body.speed = 0.0
    trip = asyncio.create_task(robot.link.drive_to(5.0, 3.0))
    await asyncio.sleep(25.0)
    assert robot.road.state is not None
    assert robot.road.state.remark == "has not moved for 20 seconds, although it may drive on"
    assert [text for text in caplog.messages if "has not moved" in text] == [f"Robot1 {robot.road.state.remark}"]
    robot.body.speed = 0.5
    await trip
    assert robot.road.state.remark is None
    assert robot.problems == []

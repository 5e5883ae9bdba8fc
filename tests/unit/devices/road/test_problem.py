"""Why a robot of any make does not work, as people are told."""

from __future__ import annotations

import asyncio

from tests.support.road_lab import LabRobot, RoadLab, in_lab


@in_lab
async def test_who_cannot_drive_says_why_until_it_can(lab: RoadLab, robot: LabRobot) -> None:
    robot.broken("its stop button is pressed")
    assert robot.problems == ["cannot drive: its stop button is pressed"]
    robot.lost("nothing is heard of its scanner")
    robot.broken(None)
    assert robot.problems[1:] == ["cannot drive: nothing is heard of its scanner"]
    robot.lost(None)
    assert robot.problems[2:] == [None]


@in_lab
async def test_who_cannot_be_reached_for_a_while_is_a_problem(lab: RoadLab, robot: LabRobot) -> None:
    robot.go_away()
    await asyncio.sleep(robot.reconnect_timeout - 1.0)
    robot.return_back()
    await asyncio.sleep(robot.reconnect_timeout)
    assert robot.problems == []
    robot.go_away()
    robot.heard(False, "nothing answers at its port")
    await asyncio.sleep(robot.reconnect_timeout + 1.0)
    robot.broken("its stop button is pressed")
    assert robot.problems == ["cannot be reached: nothing answers at its port"], "what else it has is not known now"
    robot.return_back()
    assert robot.problems[1:] == ["cannot drive: its stop button is pressed"]


@in_lab
async def test_who_is_waited_for_is_told_of_by_each_program(lab: RoadLab, robot: LabRobot) -> None:
    robot.go_away()
    await asyncio.sleep(robot.reconnect_timeout + 1.0)
    waiting = asyncio.create_task(robot.link.__aenter__())  # as when its device is started anew
    await asyncio.sleep(0)
    assert robot.problems == ["cannot be reached: nothing is heard of it"] * 2
    robot.return_back()
    await waiting
    assert robot.problems[2:] == [None]

"""What robots of any make quote for their ways comes near to what they take."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import cast

import pytest

from somrs.devices.road.motion import Motion
from somrs.service_manager.sdk.device import Task
from tests.support.road_lab import LabRobot, RoadLab, in_virtual_time

NO_TASK = cast(Task, None)
"""How long a way takes does not depend on the task."""


async def quoted_and_taken(robot: LabRobot, goal: str) -> tuple[float, float]:
    """The seconds that a robot quotes for its way to an object, and those that it takes."""
    (way,) = (await robot.link.legs(goal)).lengths
    assert way is not None
    quoted = await robot.driving_time(NO_TASK, way)
    start_time = asyncio.get_running_loop().time()
    await robot.link.approach(goal)
    return quoted, asyncio.get_running_loop().time() - start_time


@pytest.mark.parametrize("body_speed", [0.25, 0.5])
def test_quotes_come_near_to_what_is_taken_when_a_robot_has_driven_for_a_while(tmp_path: Path, body_speed: float) -> None:
    """The body is slower than its program says, or needs no time for turns."""

    async def test() -> None:
        lab = RoadLab(tmp_path, robots=("Robot1",))
        robot = lab.robots["Robot1"]
        robot.body.speed = body_speed
        await lab.start()
        assert robot.motion == Motion()
        for goal in ("Jar1", "Platform1") * 4:
            quoted, taken = await quoted_and_taken(robot, goal)
        assert quoted == pytest.approx(taken, rel=0.25)

    in_virtual_time(test())

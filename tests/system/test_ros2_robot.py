"""A whole system with a robot that is connected by ROS 2: traffic grants its ways, and its own nodes drive, pick and drop."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest
import yaml

from somrs.client.client import Client
from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from tests.support import warm
from tests.support.accomplishing import accomplish
from tests.support.building import building
from tests.support.hang import HANG_TIME
from tests.support.ros2.robots import ROS, needs_ros2, new_namespace

pytestmark = [needs_ros2, pytest.mark.long]

MAP = (
    building("Lab", 8, 6, "")
    + """
  Table1: {type: Table, at: [1, 4, 0], Shape: {Form: Box, Width: 0.6, Depth: 1, Height: 0.7}}
  Table2: {type: Table, at: [4, 4.5, 0], Shape: {Form: Box, Width: 0.6, Depth: 1, Height: 0.7}}
  Jar1: {type: Jar, at: [1.15, 4, 0.7]}
  Dock1: {type: Place, at: [5, 2, 0]}
  Robot1: {type: PioneerP3DX, at: [2.5, 3, 0], Speed: 0.8}
facts:
  - Jar1 isOn Table1
"""
)
ARM = {"action": "move_object", "type": "manipulation_msgs/action/MoveObject", "succeeds": {"success": True}}
BINDING = {
    "pose": {},
    "odometry": {},
    "pick": [{**ARM, "goal": {"pick": True, "object": "{thing}"}}],
    "drop": [{**ARM, "goal": {"object": "{thing}", "support": "{support}"}}],
}


def test_a_task_is_accomplished_by_a_robot_with_ros2(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text(json.dumps(BINDING))
    robot = {"binding": "robot.yaml", "type": "PioneerP3DX", "namespace": new_namespace(), "simulated": True}
    ros2 = {**ROS, "robots": {"Robot1": robot}}
    site = tmp_path / "site.yaml"
    site.write_text(f"{MAP}\n{yaml.safe_dump({'adapters': {'ros2': ros2}})}")

    async def run() -> None:
        system = System([site], tmp_path / "data", world=WorldKind.KINEMATIC, launcher=warm.launcher())
        async with asyncio.timeout(HANG_TIME), system, Client(system.addresses) as client:
            for effect in ("Jar1 isOn Table2", "Robot1 isAt Dock1"):
                view = await accomplish(client, effect)
                assert view.outcome == "accomplished", view.explanation

    asyncio.run(run())

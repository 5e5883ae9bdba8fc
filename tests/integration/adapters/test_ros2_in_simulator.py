"""Robots of the simulator whose own programs are ROS 2 nodes: they drive, pick and drop as those that are driven by the robot link."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import yaml
from msgspec import structs

from somrs.adapters.ros2.adapter import Ros2Adapter
from somrs.adapters.ros2.connection import RobotConnection
from somrs.adapters.ros2.frames import Pose
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.world.kinds import WorldKind
from tests.support.building import jar_lab
from tests.support.robot_lab import simulator
from tests.support.ros2.robots import ROS, Witness, connected, in_event_loop, needs_ros2, new_namespace, way

pytestmark = needs_ros2

SITE = jar_lab("Robot1: {type: PioneerP3DX, at: [3, 3, 0], Speed: 0.8}")
ORIGIN = (2.0, 1.0, 1.5)
"""Where the robot's own map is on that of the building."""
ARM = {"action": "move_object", "type": "manipulation_msgs/action/MoveObject", "succeeds": {"success": True}}
BINDING: dict[str, Any] = {
    "pose": {},
    "odometry": {},
    "pick": [{**ARM, "goal": {"pick": True, "object": "{thing}"}}],
    "drop": [{**ARM, "goal": {"object": "{thing}", "support": "{support}"}}],
}


@contextlib.asynccontextmanager
async def robot_of_simulator(binding: dict[str, Any] = BINDING) -> AsyncIterator[tuple[RobotConnection, Witness, OperatorLink]]:
    """Robot1, at (3, 3)."""
    namespace, level = new_namespace(), dict(zip(["x", "y", "yaw"], ORIGIN, strict=True))
    robots = {"Robot1": {"binding": "examples/ros2_robot.yaml", "namespace": namespace, "simulated": True, "levels": [level]}}
    async with (
        simulator(1, SITE, WorldKind.KINEMATIC) as server,
        OperatorLink(server.host, server.port) as operator,
    ):
        simulation = asyncio.create_task(Ros2Adapter({**ROS, "robots": robots}, Path.cwd()).simulate(f"{server.host}:{server.port}", {}))
        async with connected(namespace, binding, {"levels": [level]}) as (connection, witness):
            yield connection, witness, operator
        simulation.cancel()
        await asyncio.wait({simulation})


@in_event_loop
async def test_a_simulated_robot_drives_by_nav2() -> None:
    async with robot_of_simulator() as (connection, witness, operator):
        connection.follow(way((3, 3), (4, 3), (4, 3.8)))
        await witness.until(lambda: witness.passed_numbers == [1, 2])
        state = (await operator.robots())["Robot1"]
        assert (abs(state.x - 4.0) < 0.05, abs(state.y - 3.8) < 0.05) == (True, True)


@in_event_loop
async def test_a_simulated_robot_picks_and_drops_by_its_arm() -> None:
    async with robot_of_simulator() as (connection, witness, operator):
        connection.follow(way((3, 3), (1.7, 4)))
        await witness.until(lambda: witness.passed_numbers == [1])
        await connection.pick("Jar1", "Table1", Pose(1.15, 4, 0))
        assert (await operator.robots())["Robot1"].holding == "Jar1"
        await connection.drop("Jar1", "Table1", Pose(1, 4, 0))
        assert (await operator.observe("Jar1")).support == "Table1"


@in_event_loop
async def test_a_gripper_takes_what_is_before_the_robot_and_puts_it_on_what_is_there() -> None:
    example = yaml.safe_load(Path("examples/ros2_robot.yaml").read_text())
    async with robot_of_simulator(example) as (connection, witness, operator):
        start, end = way((3, 3), (1.7, 4))
        connection.follow((start, structs.replace(end, yaw=math.pi)))
        await witness.until(lambda: witness.passed_numbers == [1])
        await connection.pick("Jar1", "Table1", Pose(1.15, 4, 0))
        assert (await operator.robots())["Robot1"].holding == "Jar1"
        await connection.drop("Jar1", "Table1", Pose(1, 4, 0))
        assert (await operator.observe("Jar1")).support == "Table1"

"""The adapter's connection to robots with ROS 2: real nodes of Nav2's and ros2_control's types, in processes of their own."""

from __future__ import annotations

import asyncio
import math
import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest
import yaml
from msgspec import structs

from somrs.adapters.ros2 import save_map
from somrs.adapters.ros2.checking import check_bindings
from somrs.adapters.ros2.frames import Pose
from somrs.devices.road_robot import RobotFailed
from somrs.sites.occupancy.reading import read_grid
from tests.support.ros2.robots import (
    DOMAIN,
    PYTHON,
    ROS,
    RobotProcess,
    bridge_process,
    connected,
    in_event_loop,
    listening_to,
    needs_ros2,
    started,
    way,
)

pytestmark = needs_ros2

BINDING: dict[str, Any] = {
    "pose": {},
    "odometry": {},
    "attributes": {
        "Charge": {
            "topic": "battery_state",
            "type": "sensor_msgs/msg/BatteryState",
            "field": "percentage",
            "scale": 100,
            "dead_band": 5,
            "interval": 0.1,
        },
    },
    "faults": [{"topic": "emergency_stop", "type": "std_msgs/msg/Bool", "field": "data", "latched": True, "reason": "its stop is pressed"}],
}
BY_GRIPPER: dict[str, Any] = yaml.safe_load(Path("examples/ros2_robot.yaml").read_text())
ARM = {"action": "move_object", "type": "manipulation_msgs/action/MoveObject", "succeeds": {"success": True}}
BY_ARM = {
    **BINDING,
    "pick": [{**ARM, "goal": {"pick": True, "object": "{thing}", "support": "{support}"}}],
    "drop": [{**ARM, "goal": {"object": "{thing}", "support": "{support}"}}],
}


@in_event_loop
async def test_a_robot_drives_its_way_and_says_where_it_is() -> None:
    async with RobotProcess(speed=4.0) as robot, connected(robot, BINDING) as (connection, witness):
        connection.follow(way((0, 0), (1, 0), (2, 0), (2, 1)))
        await witness.until(lambda: witness.passed_numbers == [1, 2, 3])
        await witness.until(lambda: witness.pose[:2] == (2, 1))
        assert witness.reasons == []


@in_event_loop
async def test_the_map_of_a_robot_is_turned_and_moved_onto_that_of_the_building() -> None:
    level = {"x": 10.0, "y": 5.0, "yaw": 1.5707963267948966, "level": 3.0}
    async with RobotProcess(speed=4.0) as robot, connected(robot, BINDING, {"levels": [level]}) as (connection, witness):
        await witness.until(lambda: witness.pose == pytest.approx((10, 5, 1.5707963, 3.0)))
        connection.follow(way((10, 5), (10, 7), level=3.0))
        await witness.until(lambda: witness.passed_numbers == [1])
        await witness.until(lambda: witness.pose == pytest.approx((10, 7, 1.5707963, 3.0), abs=1e-3))


@in_event_loop
async def test_a_pose_comes_from_transforms_if_no_topic_has_it() -> None:
    binding = {"transform": {"tf": "tf", "tf_static": "tf_static"}}
    async with RobotProcess(pose=[1, 2, 0.5]) as robot, connected(robot, binding) as (_, witness):
        await witness.until(lambda: witness.pose == pytest.approx((1, 2, 0.5, 0.0)))


@in_event_loop
async def test_publishers_that_do_not_keep_their_last_message_are_heard_where_a_binding_expects_it() -> None:
    binding = {"pose": {"topic": "odom", "type": "nav_msgs/msg/Odometry", "latched": True}}
    async with RobotProcess(pose=[1, 2, 0.5]) as robot, connected(robot, binding) as (_, witness):
        await witness.until(lambda: witness.pose == pytest.approx((1, 2, 0.5, 0.0)))


@in_event_loop
async def test_a_robot_that_is_halted_stands() -> None:
    async with RobotProcess() as robot, connected(robot, BINDING) as (connection, witness):
        connection.follow(way((0, 0), (50, 0)))
        await witness.until(lambda: witness.pose[0] > 0.5)
        await connection.halt()
        await asyncio.sleep(0.3)
        place = witness.pose
        await asyncio.sleep(0.5)
        assert witness.pose == place
        assert (witness.passed_numbers, witness.reasons) == ([], [])


@in_event_loop
async def test_a_robot_that_does_not_cancel_is_followed_to_its_goal() -> None:
    async with RobotProcess() as robot:
        async with connected(robot, BINDING) as (connection, witness):
            await robot.tell("stubborn")
            connection.follow(way((0, 0), (2, 0)))
            await witness.until(lambda: witness.pose[0] > 0.2)
            await connection.halt()
            assert witness.passed_numbers == [1]
            assert witness.hindrances == ["Robot1 does not stop: it does not cancel its goal P1, and is expected there", None]
            connection.follow(way((2, 0), (4, 0), first=1))
            await witness.until(lambda: witness.pose[0] > 2.2)
        # Its goal is now that of an earlier client, of which nobody knows when it ends.
        async with connected(robot, BINDING) as (_, witness):
            await witness.until(lambda: witness.pose[0] == 4.0)
            assert witness.x_when_present > 3.0


@in_event_loop
async def test_a_robot_is_not_there_before_its_node_is_active_nor_when_it_is_deactivated() -> None:
    async with RobotProcess(managed=True) as robot, started(robot, BINDING) as (connection, witness):
        await witness.until(lambda: not math.isnan(witness.pose[0]))
        connection.follow(way((0, 0), (1, 0)))
        await asyncio.sleep(1.5)
        assert witness.presence == []
        await robot.tell("activate")
        await witness.until(lambda: witness.passed_numbers == [1])
        assert (witness.presence, witness.reasons) == ([True], [])
        await robot.tell("deactivate")
        await witness.until(lambda: witness.presence == [True, False])


async def drive_around_corners(robot: RobotProcess, action: str, kind: str) -> None:
    binding = {**BINDING, "navigate": {"action": action, "type": f"nav2_msgs/action/{kind}"}}
    async with connected(robot, binding) as (connection, witness):
        connection.follow(way((0, 0), (1, 0), (1, 1)))
        await witness.until(lambda: 1 in witness.passed_numbers)
        connection.follow(way((0, 0), (1, 0), (1, 1), (0, 0)))
        await witness.until(lambda: witness.passed_numbers == [1, 2, 3])
        assert witness.reasons == []


@in_event_loop
async def test_a_robot_drives_around_corners_by_goals_through_poses_and_along_paths() -> None:
    async with RobotProcess(speed=2.0) as robot:
        await drive_around_corners(robot, "navigate_through_poses", "NavigateThroughPoses")
        await drive_around_corners(robot, "follow_path", "FollowPath")


@in_event_loop
async def test_a_robot_that_loses_its_way_is_stopped_until_it_has_found_it() -> None:
    async with RobotProcess() as robot, connected(robot, BINDING) as (connection, witness):
        connection.follow(way((0, 0), (50, 0)))
        await witness.until(lambda: witness.pose[0] > 0.5)
        await robot.tell("lost")
        await witness.until(lambda: len(witness.losses) == 1)
        await connection.halt()
        await robot.tell("normal")
        await witness.until(lambda: witness.losses[1:] == [None])
        place = witness.pose
        await asyncio.sleep(0.3)
        assert witness.pose == place


@in_event_loop
async def test_a_longer_way_is_driven_without_a_stop() -> None:
    async with RobotProcess(speed=2.0) as robot, connected(robot, BINDING) as (connection, witness):
        connection.follow(way((0, 0), (1, 0)))
        await witness.until(lambda: witness.pose[0] > 0.5)
        connection.follow(way((0, 0), (1, 0), (2, 0)))
        await witness.until(lambda: witness.passed_numbers == [1, 2])
        assert witness.reasons == []


@in_event_loop
async def test_what_the_navigation_says_when_it_gives_up_is_told() -> None:
    async with RobotProcess() as robot, connected(robot, BINDING) as (connection, witness):
        await robot.tell("abort")
        connection.follow(way((0, 0), (5, 0)))
        await witness.until(lambda: bool(witness.reasons))
        assert witness.reasons == ["the navigation of Robot1 aborted the goal P1: no valid path"]


@in_event_loop
async def test_a_goal_that_is_rejected_is_sent_again() -> None:
    async with RobotProcess(speed=4.0) as robot, connected(robot, BINDING) as (connection, witness):
        await robot.tell("reject")
        connection.follow(way((0, 0), (2, 0)))
        await witness.until(lambda: witness.hindrances == ["the navigation of Robot1 rejects its goal P1; it is asked again"])
        await robot.tell("normal")
        await witness.until(lambda: witness.passed_numbers == [1])
        assert witness.hindrances[1:] == [None]
        assert witness.reasons == []


@in_event_loop
async def test_a_robot_whose_node_dies_drives_on_when_it_is_started_again() -> None:
    async with RobotProcess() as robot, connected(robot, BINDING) as (connection, witness):
        connection.follow(way((0, 0), (1, 0), (2, 0)))
        await witness.until(lambda: witness.passed_numbers == [1])
        await robot.kill()
        await witness.until(lambda: witness.presence == [True, False])
        await robot.start(pose=[witness.pose[0], 0, 0])
        await witness.until(lambda: witness.presence == [True, False, True])
        await witness.until(lambda: witness.passed_numbers == [1, 2])
        assert witness.reasons == []


@in_event_loop
async def test_a_node_that_is_back_before_its_absence_is_noticed_gets_its_goal_again() -> None:
    async with RobotProcess() as robot, connected(robot, BINDING) as (connection, witness):
        connection.follow(way((0, 0), (1, 0), (2, 0)))
        await witness.until(lambda: witness.passed_numbers == [1])
        await robot.kill()
        await robot.start(pose=[witness.pose[0], 0, 0])
        await witness.until(lambda: witness.passed_numbers == [1, 2])


@in_event_loop
async def test_a_robot_whose_adapter_has_ended_is_stopped() -> None:
    async with RobotProcess() as robot:
        async with connected(robot, BINDING) as (connection, witness):
            connection.follow(way((0, 0), (50, 0)))
            await witness.until(lambda: witness.pose[0] > 0.5)
        async with listening_to(robot) as witness:
            await witness.until(lambda: witness.pose[0] > 0.5)
            place = witness.pose
            await asyncio.sleep(0.5)
            assert witness.pose == place


@in_event_loop
async def test_a_robot_is_halted_by_an_adapter_that_is_started_again() -> None:
    async with RobotProcess() as robot:
        async with connected(robot, BINDING) as (connection, witness):
            connection.follow(way((0, 0), (50, 0)))
            await witness.until(lambda: witness.pose[0] > 0.5)
            os.kill(bridge_process(), signal.SIGKILL)
        async with connected(robot, BINDING) as (_, witness):
            await witness.until(lambda: witness.pose[0] > 0.5)
            await asyncio.sleep(0.3)
            place = witness.pose
            await asyncio.sleep(0.5)
            assert witness.pose == place


@in_event_loop
async def test_the_gripper_of_the_example_takes_a_thing_and_puts_it_down() -> None:
    async with RobotProcess(things={"Jar1": [0.5, 0]}) as robot, connected(robot, BY_GRIPPER) as (connection, _):
        await connection.pick("Jar1", "Table1", Pose(0.5, 0, 0))
        await connection.drop("Jar1", "Table2", Pose(0.5, 0, 0))
        await connection.pick("Jar1", "Table2", Pose(0, 0, 0))


@in_event_loop
async def test_a_gripper_that_closes_on_nothing_has_failed() -> None:
    async with RobotProcess() as robot, connected(robot, BY_GRIPPER) as (connection, _):
        with pytest.raises(RobotFailed, match="the gripper closed on nothing"):
            await connection.pick("Jar1", "Table1", Pose(0.5, 0, 0))


@in_event_loop
async def test_an_arm_is_told_the_names_of_things() -> None:
    things = {"Jar1": [0.5, 0], "Jar2": [0.1, 0]}
    async with RobotProcess(things=things) as robot, connected(robot, BY_ARM) as (connection, _):
        await connection.pick("Jar1", "Table1", Pose(0.5, 0, 0))
        with pytest.raises(RobotFailed, match="move_object: success is False"):
            await connection.pick("Jar2", "Table1", Pose(0.5, 0, 0))


@in_event_loop
async def test_what_an_arm_does_can_be_interrupted() -> None:
    async with RobotProcess() as robot, connected(robot, BY_ARM) as (connection, _):
        await robot.tell("slow")
        picking = asyncio.create_task(connection.pick("Jar1", "Table1", Pose(0.5, 0, 0)))
        await asyncio.sleep(0.3)
        await connection.interrupt()
        with pytest.raises(RobotFailed, match="the goal of move_object was canceled"):
            await picking


@in_event_loop
async def test_an_arm_whose_node_dies_has_failed() -> None:
    async with RobotProcess() as robot, connected(robot, BY_ARM) as (connection, _):
        await robot.tell("slow")
        picking = asyncio.create_task(connection.pick("Jar1", "Table1", Pose(0.5, 0, 0)))
        await asyncio.sleep(0.3)
        await robot.kill()
        with pytest.raises(RobotFailed, match="the goal of move_object was lost: its server has ended"):
            await picking


@in_event_loop
async def test_a_battery_is_charged_until_it_is_full() -> None:
    service = {"service": "charge", "type": "std_srvs/srv/SetBool", "succeeds": {"success": True}}
    charge = {"begin": [{**service, "request": {"data": True}}], "end": [{**service, "request": {"data": False}}]}
    async with RobotProcess(battery=0.42) as robot, connected(robot, {**BINDING, "charge": charge}) as (connection, witness):
        await witness.until(lambda: witness.values.get("Charge") == [42])
        await connection.charge("Charger1", Pose(0, 0, 0))
        assert witness.values["Charge"][-1] == 100


@in_event_loop
async def test_a_pressed_emergency_stop_is_told_with_its_reason() -> None:
    async with RobotProcess() as robot, connected(robot, BINDING) as (_, witness):
        await robot.tell("press")
        await witness.until(lambda: witness.faults == ["its stop is pressed"])
        await robot.tell("release")
        await witness.until(lambda: witness.faults == ["its stop is pressed", None])


@in_event_loop
async def test_a_speed_limit_is_told_with_the_way_that_has_it() -> None:
    limited = tuple(structs.replace(waypoint, speed_limit=2.0) for waypoint in way((0, 0), (3, 0)))
    async with RobotProcess(speed=4.0) as robot, connected(robot, {**BINDING, "speed_limit": {}}) as (connection, witness):
        start = time.monotonic()
        connection.follow(limited)
        await witness.until(lambda: witness.passed_numbers == [1])
        assert time.monotonic() - start > 1.2


def test_the_map_of_a_robot_is_saved_for_the_import(tmp_path: Path) -> None:
    async def robot_with_map() -> None:
        async with RobotProcess(grid=[6, 4]) as robot:
            out = ["--out", str(tmp_path / "floor"), "--topic", f"/{robot.namespace}/map"]
            ros = ["--python", str(PYTHON), "--domain", str(DOMAIN), "--discovery", "LOCALHOST"]
            await asyncio.to_thread(save_map.main, [*out, *ros])

    asyncio.run(robot_with_map())
    grid = read_grid(tmp_path / "floor.yaml")
    assert (grid.shape, grid.resolution) == ((4, 6), 0.5)
    assert grid.states.tolist()[:2] == [[1, 1, 1, 1, 1, 1], [1, -1, 0, 0, 0, 1]]


@in_event_loop
async def test_a_bridge_that_is_killed_is_started_again_and_the_robot_goes_on() -> None:
    async with RobotProcess() as robot, connected(robot, BINDING) as (connection, witness):
        connection.follow(way((0, 0), (1, 0), (2, 0)))
        await witness.until(lambda: witness.passed_numbers == [1])
        os.kill(bridge_process(), signal.SIGKILL)
        await witness.until(lambda: witness.presence == [True, False, True])
        await witness.until(lambda: witness.passed_numbers == [1, 2])
        assert witness.reasons == []


WRONG = """
pose: {topic: amcl_pose, type: geometry_msgs/msg/PoseStamped, field: pose}
odometry: {topic: odometry}
navigate: {action: navigate_to_pose, type: nav2_msgs/action/NavigateToPos}
pick: [{action: gripper_cmd, type: control_msgs/action/GripperCommand, goal: {command: {width: 0}}}]
drop: [{service: charge, type: std_srvs/srv/SetBool, request: {data: true}, succeeds: {done: true}}]
attributes:
  Charge: {topic: battery_state, type: sensor_msgs/msg/BatteryState, field: percentage}
"""
PROBLEMS = {
    "pose": "is of the type geometry_msgs/msg/PoseWithCovarianceStamped, and not geometry_msgs/msg/PoseStamped",
    "odometry": "odometry: is it /",
    "navigate": "the type nav2_msgs/action/NavigateToPos is not installed",
    "pick.0": "command.width: GripperCommand has no such field; it has position, max_effort",
    "drop.0": "there is no field done: the message has the fields success, message",
}


def test_a_binding_is_checked_against_the_robot(tmp_path: Path) -> None:
    async def problems() -> dict[str, str]:
        async with RobotProcess() as robot:
            settings = {**ROS, "robots": {"Robot1": {"binding": "robot.yaml", "namespace": robot.namespace}}}
            return {row.place: row.problem for row in await check_bindings(settings, tmp_path, 3.0) if row.problem}

    (tmp_path / "robot.yaml").write_text(WRONG)
    problems_by_place = asyncio.run(problems())
    assert problems_by_place.keys() == PROBLEMS.keys()
    for place, problem in PROBLEMS.items():
        assert problem in problems_by_place[place]

"""Where a robot says that it is has to agree with what it holds in traffic."""

from __future__ import annotations

import asyncio
import math

import pytest

from somrs.devices.road.whereabouts import Surroundings, Whereabouts
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.space.lines import point_distance
from somrs.space.solids import Point
from tests.support.road_lab import LabRobot, RoadLab, in_lab

WALL = (3.0, -5.0), (3.0, 5.0)


def around(*, is_driving: bool = True) -> Surroundings:
    """A robot before a wall."""
    return Surroundings(is_driving, lambda point: point_distance(point, *WALL) > 0.0)


def judge(*points: Point, is_driving: bool = True, pause: float = 0.1) -> tuple[list[bool], Whereabouts]:
    """What is believed of points that a robot says one after the other."""
    whereabouts = Whereabouts()
    beliefs = [whereabouts.take(point, 0.0, pause * index, around(is_driving=is_driving)) for index, point in enumerate(points)]
    return beliefs, whereabouts


def test_a_robot_that_drives_is_believed() -> None:
    beliefs, whereabouts = judge(*((0.05 * index, 0.0) for index in range(50)))
    assert all(beliefs)
    assert whereabouts.problem is None


def test_a_localisation_may_correct_itself() -> None:
    assert judge((0.0, 0.0), (0.6, 0.5), (0.0, 0.0))[0] == [True, True, True]


def test_a_pose_where_nothing_can_stand_is_doubted_however_long_it_stays() -> None:
    beliefs, whereabouts = judge((0.0, 0.0), (3.0, 1.3), *[(1.5, 1.3)] * 100)
    assert not any(beliefs[1:])
    assert "its pose is (3.00, 1.30), where nothing can stand; it was at (0.00, 0.00)" in (whereabouts.problem or "")


def test_reports_that_are_late_and_come_all_at_once_are_believed() -> None:
    assert all(judge(*((2.0 * index, 0.0) for index in range(20)), pause=0.0)[0])


def test_who_is_back_where_it_was_is_believed_again() -> None:
    beliefs, whereabouts = judge((0.0, 0.0), (3.0, 1.3), (0.1, 0.1))
    assert beliefs == [True, False, True]
    assert whereabouts.problem is None


def test_who_is_confirmed_is_believed() -> None:
    _, whereabouts = judge((0.0, 0.0), (3.0, 1.3))
    whereabouts.confirm()
    assert whereabouts.take((1.5, 1.3), 0.0, 1.0, around())


def test_who_stands_may_be_carried_elsewhere_but_not_into_a_wall() -> None:
    assert judge((0.0, 0.0), (5.0, 2.0), is_driving=False)[0] == [True, True]
    beliefs, whereabouts = judge((0.0, 0.0), (3.0, 2.0), (2.0, 2.0), is_driving=False)
    assert beliefs == [True, False, True]
    assert whereabouts.problem is None


async def _pushed_to(robot: LabRobot, x: float, y: float) -> None:
    """A robot is pushed somewhere by hand; its localisation follows."""
    steps = math.ceil(math.dist((robot.body.x, robot.body.y), (x, y)) / 0.05)
    start = robot.body.x, robot.body.y
    for step in range(1, steps + 1):
        robot.body.x, robot.body.y = (begin + (end - begin) * step / steps for begin, end in zip(start, (x, y), strict=True))
        await asyncio.sleep(0.1)


@in_lab
@pytest.mark.parametrize("is_carried", [False, True])
async def test_an_idle_robot_that_is_moved_has_the_place_where_it_is(lab: RoadLab, robot: LabRobot, is_carried: bool) -> None:
    """Seen with ROS 2: another robot was driven into it."""
    visitor = lab.robots["Robot2"]
    if is_carried:
        robot.body.x, robot.body.y = 5.3, 2.9
    else:
        await _pushed_to(robot, 5.3, 2.9)
    await asyncio.sleep(5.0)
    trip = asyncio.create_task(visitor.link.drive_to(5.3, 2.9))
    nearest = math.inf
    while not trip.done():
        nearest = min(nearest, math.dist((visitor.body.x, visitor.body.y), (robot.body.x, robot.body.y)))
        await asyncio.sleep(0.1)
    assert nearest > 0.4
    assert math.dist((robot.body.x, robot.body.y), (5.3, 2.9)) > 0.4, "it has made room"
    await trip


@in_lab
async def test_a_robot_that_is_put_where_it_sees_no_place_says_so(lab: RoadLab, robot: LabRobot) -> None:
    held = lab.held("Robot1")
    robot.body.x = 20.0
    await asyncio.sleep(10.0)
    assert robot.link.state is not None
    assert "its pose is (20.00, 1.50), where nothing can stand" in (robot.link.state.trouble or "")
    assert robot.link.state.x < 10
    assert lab.held("Robot1") == held
    robot.body.x = 2.0
    await asyncio.sleep(5.0)
    await robot.link.drive_to(3.0, 1.5)


@in_lab
async def test_a_robot_that_says_that_it_has_come_where_it_is_not_has_not_arrived(lab: RoadLab, robot: LabRobot) -> None:
    """Seen with ROS 2: its action succeeded without moving, and another robot was sent to where it still stood."""
    robot.body.speed = 0.0
    trip = asyncio.create_task(robot.link.drive_to(5.0, 3.5))
    while not robot.body.base or max(robot.body.base) == robot.body.passed:
        await asyncio.sleep(0.1)
    robot.body.passed = max(robot.body.base)
    with pytest.raises(RobotGaveUp, match=r"says that it has come to .*, but its pose is elsewhere"):
        await trip
    await asyncio.sleep(3.0)
    (place,) = robot.ways_told[-1]
    assert lab.held("Robot1") == (place.name,)
    assert (place.x, place.y) == pytest.approx((robot.body.x, robot.body.y), abs=0.01)


@in_lab
async def test_a_robot_whose_pose_jumps_while_it_drives_is_stopped_until_somebody_has_seen_to_it(lab: RoadLab, robot: LabRobot) -> None:
    trip = asyncio.create_task(robot.link.drive_to(6.0, 4.8))
    while robot.body.passed < 2:
        await asyncio.sleep(0.1)
    x, y, robot.body.x = robot.body.x + 1.2, robot.body.y + 1.5, 20.0
    with pytest.raises(RobotGaveUp, match="where nothing can stand"):
        await trip
    await asyncio.sleep(1.0)
    held = lab.held("Robot1")
    assert held
    for _ in range(30):
        await asyncio.sleep(1.0)
        assert lab.held("Robot1") == held
    robot.body.x, robot.body.y = x, y
    with pytest.raises(RobotGaveUp, match="where nothing can stand"):
        await robot.link.drive_to(6.0, 4.8)
    robot.road.confirm()
    await asyncio.sleep(3.0)
    assert lab.held("Robot1") != held
    await robot.link.drive_to(6.0, 4.8)


@in_lab
async def test_a_robot_that_does_not_know_where_it_is_keeps_what_it_has_and_is_halted(lab: RoadLab, robot: LabRobot) -> None:
    trip = asyncio.create_task(robot.link.drive_to(6.0, 4.8))
    while robot.body.passed < 2:
        await asyncio.sleep(0.1)
    robot.lost("nothing comes on /tf")
    with pytest.raises(RobotGaveUp, match="Robot1 cannot drive: nothing comes on /tf"):
        await trip
    assert not robot.body.base
    await asyncio.sleep(1.0)
    held = lab.held("Robot1")
    robot.body.x += 0.5  # it rolled on, and its program does not know it
    await asyncio.sleep(40.0)
    assert lab.held("Robot1") == held
    robot.lost(None)
    await robot.link.drive_to(6.0, 4.8)

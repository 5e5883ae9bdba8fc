"""The pose of a robot, from what its encoders count."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.adapters.arcos.messages import Status
from somrs.adapters.arcos.odometry import Odometry, Pose
from somrs.adapters.arcos.parameters import TYPES, Parameters

ROBOT = TYPES["p3dx"]


def counted(x: float, y: float = 0.0, heading: float = 0.0, parameters: Parameters = ROBOT) -> Status:
    """A report with travel in metres and radians, as a P3-DX counts it."""
    return Status(
        is_moving=True,
        x=round(x / parameters.metres) & 0xFFFF,
        y=round(y / parameters.metres) & 0xFFFF,
        heading=round(heading / parameters.radians),
        left_speed=0,
        right_speed=0,
        battery=120,
        stall=0,
        flags=1,
    )


def test_where_counters_begin_does_not_matter() -> None:
    odometry = Odometry(Pose(x=1.0, y=2.0, yaw=math.pi / 2))
    odometry.update(counted(7.0, 3.0), ROBOT)
    pose = odometry.update(counted(7.2, 3.0), ROBOT)
    assert (pose.x, pose.y, pose.yaw) == pytest.approx((1.0, 2.2, math.pi / 2), abs=0.001)


@given(st.lists(st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2)), min_size=1, max_size=300))
def test_counters_wrap_around(steps: list[tuple[float, float]]) -> None:
    odometry, x, y = Odometry(Pose(x=0.0, y=0.0, yaw=0.0)), 15.8, -15.8
    odometry.update(counted(x, y), ROBOT)
    for dx, dy in steps:
        x, y = x + dx, y + dy
        odometry.update(counted(x, y), ROBOT)
    assert (odometry.pose.x, odometry.pose.y) == pytest.approx((x - 15.8, y + 15.8), abs=0.002)


def test_counters_that_begin_anew_do_not_move_the_robot() -> None:
    odometry = Odometry(Pose(x=0.0, y=0.0, yaw=0.0))
    for x in (1.0, 1.1, 0.0, 0.0, 0.1):
        odometry.update(counted(x), ROBOT)
    assert odometry.pose.x == pytest.approx(0.2, abs=0.002)


def test_one_wrong_report_is_left_out() -> None:
    odometry = Odometry(Pose(x=0.0, y=0.0, yaw=0.0))
    for x in (1.0, 1.1, 6.2, 1.3, 1.4):
        odometry.update(counted(x), ROBOT)
        assert odometry.pose.x < 0.41
    assert odometry.pose.x == pytest.approx(0.4, abs=0.002)


def test_lost_reports_lose_no_travel() -> None:
    odometry = Odometry(Pose(x=0.0, y=0.0, yaw=0.0))
    for x in (1.0, 3.5, 5.5):
        odometry.update(counted(x), ROBOT)
    assert odometry.pose.x == pytest.approx(4.5, abs=0.002)

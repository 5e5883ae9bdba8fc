"""Poses between the map of the building, that of a robot, and the frames of /tf."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.adapters.ros2.frames import Pose, TransformTree, pose_of

COORDINATES = st.floats(-100, 100)
POSES = st.builds(Pose, COORDINATES, COORDINATES, st.floats(-3, 3))


def _transform(parent: str, child: str, x: float, y: float, yaw: float) -> dict[str, object]:
    rotation = {"x": 0.0, "y": 0.0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}
    return {
        "header": {"frame_id": parent},
        "child_frame_id": child,
        "transform": {"translation": {"x": x, "y": y, "z": 0.0}, "rotation": rotation},
    }


@given(frame=POSES, pose=POSES)
def test_a_pose_comes_back_from_another_frame(frame: Pose, pose: Pose) -> None:
    assert frame.inverse().apply(frame.apply(pose)) == pytest.approx(pose, abs=1e-9)


def test_a_turned_frame_turns_its_poses() -> None:
    assert Pose(10, 5, math.pi / 2).apply(Pose(2, 0, 0)) == pytest.approx((10, 7, math.pi / 2))


def test_transforms_are_followed_from_the_base_to_the_map() -> None:
    tree = TransformTree()
    assert tree.add([_transform("map", "odom", 1, 0, math.pi / 2), _transform("/odom", "base_footprint", 2, 0, 0)])
    assert tree.pose("base_link", "map") is None
    tree.add([_transform("base_footprint", "base_link", 0, 0, 0)])
    assert tree.pose("base_link", "map") == pytest.approx((1, 2, math.pi / 2))


def test_frames_in_a_circle_have_no_pose() -> None:
    tree = TransformTree()
    tree.add([_transform("a", "b", 0, 0, 0), _transform("b", "a", 0, 0, 0)])
    assert tree.pose("a", "map") is None


@pytest.mark.parametrize("transforms", [[None], [{}], [{"header": {}, "child_frame_id": 3}], [{"header": None}], ["x"]])
def test_what_is_no_transform_is_ignored(transforms: list[object]) -> None:
    assert not TransformTree().add(transforms)


@pytest.mark.parametrize(
    "value",
    [
        None,
        {},
        {"position": {"x": None, "y": 0.0}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}},
        {"position": {"x": 0.0, "y": 0.0}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0}},
    ],
)
def test_a_robot_that_does_not_know_where_it_is_has_no_pose(value: object) -> None:
    assert pose_of(value) is None

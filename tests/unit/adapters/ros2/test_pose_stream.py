"""Poses that do not come any more are missed by the rhythm in which they came."""

from __future__ import annotations

from somrs.adapters.ros2.pose_stream import LEARNT, PoseStream

MAP = ("base_link", "odom")


def stream(gap: int, poses: int = LEARNT, *, is_driving: bool = True) -> PoseStream:
    """A stream with so many other messages before each pose."""
    poses_seen = PoseStream()
    for _ in range(poses):
        for _ in range(gap):
            poses_seen.wait(1.0)
        poses_seen.add(is_driving=is_driving)
    return poses_seen


def messages_until_missing(poses: PoseStream, limit: int = 1000) -> int | None:
    for count in range(1, limit):
        poses.wait(1.0)
        if poses.is_missing:
            return count
    return None


def test_poses_are_missed_after_some_usual_gaps() -> None:
    assert messages_until_missing(stream(1)) == 16
    assert messages_until_missing(stream(20)) == 101


def test_poses_are_not_missed_before_their_rhythm_is_known() -> None:
    assert messages_until_missing(stream(1, LEARNT - 1)) is None
    assert messages_until_missing(stream(1, 100, is_driving=False)) is None


def test_a_pose_ends_that_they_are_missed() -> None:
    poses = stream(1)
    messages_until_missing(poses)
    poses.add(is_driving=False)
    assert not poses.is_missing
    assert messages_until_missing(poses) == 16


def test_a_pose_is_the_transforms_of_all_its_frames() -> None:
    """That of a localisation may end, and that of the odometry go on."""
    poses = PoseStream()
    for _ in range(LEARNT):
        for frames in ({"base_link"}, {"base_link", "wheel"}, {"odom"}):
            poses.add_part(frames, MAP, is_driving=True)
    assert not poses.is_missing
    for _ in range(20):
        poses.add_part({"base_link"}, MAP, is_driving=True)
    assert poses.is_missing
    poses.add_part({"odom"}, MAP, is_driving=True)
    assert not poses.is_missing

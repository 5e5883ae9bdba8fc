"""Poses in the plane, in different frames: the map of the building, that of a robot, and those of /tf."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple


class Pose(NamedTuple):
    """A pose in a frame, or a frame in another: metres and radians."""

    x: float
    y: float
    yaw: float

    def apply(self, pose: Pose) -> Pose:
        """The pose, given in this frame, in the frame in which this frame is given."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return Pose(self.x + cos * pose.x - sin * pose.y, self.y + sin * pose.x + cos * pose.y, wrap(self.yaw + pose.yaw))

    def inverse(self) -> Pose:
        """The other frame in this one."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return Pose(-cos * self.x - sin * self.y, sin * self.x - cos * self.y, wrap(-self.yaw))


def wrap(angle: float) -> float:
    """The angle between -π and π."""
    return math.remainder(angle, math.tau)


def pose_of(value: object) -> Pose | None:
    """The pose in the values of a geometry_msgs/Pose or Transform; None if it has none, as when a robot does not know where it is."""
    if not isinstance(value, Mapping):
        return None
    position, turn = value.get("position", value.get("translation")), value.get("orientation", value.get("rotation"))
    if not (isinstance(position, Mapping) and isinstance(turn, Mapping)):
        return None
    numbers = [position.get("x"), position.get("y"), *(turn.get(axis) for axis in "xyzw")]
    if not all(isinstance(number, int | float) and math.isfinite(number) for number in numbers):
        return None
    x, y, qx, qy, qz, qw = (float(number) for number in numbers if number is not None)
    if qx == qy == qz == qw == 0.0:
        return None
    return Pose(x, y, math.atan2(2 * (qw * qz + qx * qy), qw * qw + qx * qx - qy * qy - qz * qz))


class TransformTree:
    """The newest transforms of /tf and /tf_static. Tilts are left out: robots drive on level floors."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Pose]] = {}

    def add(self, transforms: Iterable[Any]) -> set[str]:
        """Take the transforms of a tf2_msgs/TFMessage. Returns the frames that they are of."""
        frames: set[str] = set()
        for transform in transforms:
            if not isinstance(transform, Mapping) or not isinstance(transform.get("header"), Mapping):
                continue
            parent, child, pose = transform["header"].get("frame_id"), transform.get("child_frame_id"), pose_of(transform.get("transform"))
            if isinstance(parent, str) and isinstance(child, str) and pose is not None:
                self._parents[child.lstrip("/")] = (parent.lstrip("/"), pose)
                frames.add(child.lstrip("/"))
        return frames

    def pose(self, frame: str, ancestor: str) -> Pose | None:
        """The pose of a frame in one of its ancestors; None if they are not connected yet."""
        if (line := self.line(frame, ancestor)) is None:
            return None
        pose = Pose(0.0, 0.0, 0.0)
        for link in line:
            pose = self._parents[link][1].apply(pose)
        return pose

    def line(self, frame: str, ancestor: str) -> list[str] | None:
        """The frames from one up to its ancestor, without that; None if they are not connected yet."""
        line: list[str] = []
        while frame != ancestor:
            if frame not in self._parents or frame in line:
                return None
            line.append(frame)
            frame = self._parents[frame][0]
        return line

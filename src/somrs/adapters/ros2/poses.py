"""Poses of goals as templates have them: in the robot's map of its floor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from somrs.adapters.ros2.frames import Pose
from somrs.adapters.ros2.settings import Level

SPACING = 0.05
"""Distance between two poses of a path, m: controllers take paths as planners make them, one pose a cell."""


def pose_values(pose: Pose, level: Level) -> dict[str, Any]:
    """What templates say of a pose on the map of the building."""
    x, y, yaw = level.origin.inverse().apply(pose)
    return {"x": x, "y": y, "yaw": yaw, "qz": math.sin(yaw / 2), "qw": math.cos(yaw / 2), "frame": level.frame}


def goal_values(start: tuple[float, float], poses: Sequence[Pose], level: Level) -> dict[str, Any]:
    """What templates say of a goal: its last pose; `poses`, all poses to drive through; and `path`, close poses along the straight lines
    from a point through them. Both are lists of geometry_msgs/PoseStamped."""
    return {
        **pose_values(poses[-1], level),
        "poses": [_stamped(pose, level) for pose in poses],
        "path": [_stamped(pose, level) for pose in _path(start, poses)],
    }


def _stamped(pose: Pose, level: Level) -> dict[str, Any]:
    values = pose_values(pose, level)
    place = {"position": {"x": values["x"], "y": values["y"]}, "orientation": {"z": values["qz"], "w": values["qw"]}}
    return {"header": {"frame_id": level.frame}, "pose": place}


def _path(start: tuple[float, float], poses: Sequence[Pose]) -> list[Pose]:
    path = []
    starts = [start, *((pose.x, pose.y) for pose in poses[:-1])]
    for (x, y), end in zip(starts, poses, strict=True):
        count = max(1, math.ceil(math.dist((x, y), (end.x, end.y)) / SPACING))
        path += [Pose(x + (end.x - x) * part / count, y + (end.y - y) * part / count, end.yaw) for part in range(count)]
    return [*path, poses[-1]]

"""A robot's joints, by name: what robots read and drive, whatever moves the joints."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

BASE_JOINTS = ("x", "y", "yaw")
ARM_JOINTS = ("turret", "lift", "reach", "wrist", "left", "right")
ARM_SEEN = ARM_JOINTS[:5]
"""The joints that describe the pose of an arm; both fingers are equally open."""
LIFT_TOP = 1.75
"""Largest height of the boom, m: enough to take a tall bottle from a top at 1.2 m."""


class Joints(ABC):
    """The joints of one robot. Those of the base are driven by speed, those of the arm by position."""

    @abstractmethod
    def __getitem__(self, joint: str) -> float:
        """The position of a joint, m or rad."""

    @abstractmethod
    def start(self, joint: str, position: float) -> None:
        """Set a joint's position without motion, for a robot that is added."""

    @abstractmethod
    def drive(self, joint: str, target: float) -> None:
        """Set a target: a speed for the base, a position for the arm."""

    @abstractmethod
    def pose(self) -> tuple[float, float, float]:
        """The base's x, y and yaw on the map; yaw in (-pi, pi]."""

    @abstractmethod
    def speed(self) -> tuple[float, float]:
        """The speed of the base (m/s), and its turning speed (rad/s)."""


def wrapped(yaw: float) -> float:
    """The equivalent angle in (-pi, pi]."""
    return math.atan2(math.sin(yaw), math.cos(yaw))

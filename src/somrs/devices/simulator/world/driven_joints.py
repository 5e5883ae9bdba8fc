"""The joints of a robot that moves without forces: each is where it was driven to when a control period is over."""

from __future__ import annotations

import math

from somrs.devices.simulator.world.joints import ARM_JOINTS, LIFT_TOP, Joints, wrapped
from somrs.space.dimensions import OPENING, dimensions_of
from somrs.space.solids import Solid


class DrivenJoints(Joints):
    """The joints of one robot. It enters itself into `moving` when it has to be advanced."""

    def __init__(self, solid: Solid, moving: dict[DrivenJoints, None]) -> None:
        self.name, self._moving = solid.name, moving
        self._base = {"x": solid.x, "y": solid.y, "yaw": solid.yaw}
        self._speeds = {"x": 0.0, "y": 0.0, "yaw": 0.0}
        size = dimensions_of(solid)
        self._arm = dict.fromkeys(ARM_JOINTS, 0.0) if size.gripper else {}
        self._targets: dict[str, float] = {}
        self._ranges = {
            "lift": (size.height + 0.03, LIFT_TOP),
            "reach": (0.0, size.farthest + 0.02),
            "left": (0.0, OPENING),
            "right": (0.0, OPENING),
        }
        self._pose = solid.x, solid.y, wrapped(solid.yaw)

    def __getitem__(self, joint: str) -> float:
        return self._base[joint] if joint in self._base else self._arm[joint]

    def start(self, joint: str, position: float) -> None:
        if joint in self._base:
            self._base[joint] = position
            self._pose = self._base["x"], self._base["y"], wrapped(self._base["yaw"])
        else:
            self._arm[joint] = position

    def drive(self, joint: str, target: float) -> None:
        if joint in self._speeds:
            if target == self._speeds[joint]:
                return
            self._speeds[joint] = target
        else:
            low, high = self._ranges.get(joint, (-math.inf, math.inf))
            self._targets[joint] = min(max(target, low), high)
        self._moving[self] = None

    def advance(self, period: float) -> bool:
        """Move for one control period. Returns whether the robot moves on if it is not driven otherwise."""
        self._arm.update(self._targets)
        self._targets.clear()
        speeds, base = self._speeds, self._base
        if not (speeds["x"] or speeds["y"] or speeds["yaw"]):
            return False
        for joint, speed in speeds.items():
            base[joint] += speed * period
        self._pose = base["x"], base["y"], wrapped(base["yaw"])
        return True

    def pose(self) -> tuple[float, float, float]:
        return self._pose

    def speed(self) -> tuple[float, float]:
        return math.hypot(self._speeds["x"], self._speeds["y"]), self._speeds["yaw"]

"""Whether a robot can drive, what keeps it from that, and what its states say of it."""

from __future__ import annotations

from somrs.devices.road.hardware import Vehicle
from somrs.devices.road.whereabouts import Whereabouts
from somrs.devices.simulator.link.commands import Fault, RobotState


class Condition:
    """That of one robot. Call `renew` when something has changed."""

    def __init__(self, robot: Vehicle) -> None:
        self._robot = robot
        self.whereabouts = Whereabouts()
        self.broken: str | None = None
        """Why it cannot drive, as it says."""
        self.held_up: str | None = None
        """For what in traffic it waits, for people."""
        self.complaint: str | None = None
        """Why it does not take part in traffic, for people."""
        self.trouble: str | None = None
        """Why it cannot drive, as a sentence; None if it can."""
        self.is_lost = False
        """Whether nobody knows where it is."""

    def renew(self) -> None:
        problem = self.whereabouts.problem
        reason, self.is_lost = self.broken or problem, problem is not None
        self.trouble = f"{self._robot.name} cannot drive: {reason}" if reason is not None else None

    def state(self, now: float, pose: tuple[float, float, float], level: float, activity: str | None) -> RobotState:
        """Its state at a pose, in metres and radians, on the floor at a height, while it carries out a command."""
        robot, (x, y, yaw) = self._robot, pose
        return RobotState(
            time=now,
            x=x,
            y=y,
            yaw=yaw,
            holding=robot.holding,
            activity=activity,
            faults=(Fault.DRIVE,) if self.trouble is not None else (),
            z=level,
            charge=robot.battery,
            hindrance=robot.hindrance or self.complaint or self.held_up,
            trouble=self.trouble,
            remark=robot.remark,
        )

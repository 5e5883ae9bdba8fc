"""Whether a robot can drive, what keeps it from that, and what its states say of it."""

from __future__ import annotations

from somrs.devices.road.hardware import Vehicle
from somrs.devices.road.problem import Problem
from somrs.devices.road.reach import Reach
from somrs.devices.road.standstill import Standstill
from somrs.devices.road.whereabouts import Whereabouts
from somrs.devices.simulator.link.commands import Fault, RobotState


class Condition:
    """That of one robot. Call `renew` when something has changed."""

    def __init__(self, robot: Vehicle) -> None:
        self._robot = robot
        self.whereabouts, self.reach = Whereabouts(), Reach()
        self.standstill = Standstill(robot.name)
        self.broken: str | None = None
        """Why it cannot drive, as it says."""
        self.held_up: str | None = None
        """For what in traffic it waits, for people."""
        self.complaint: str | None = None
        """Why it does not take part in traffic, for people."""
        self.trouble: str | None = None
        """Why it cannot drive, as a sentence; None if it can."""
        self._fault: str | None = None
        """The same without its name."""
        self.is_lost = False
        """Whether nobody knows where it is."""
        self._problem = Problem(robot.report_problem, robot.reconnect_timeout)

    def renew(self) -> None:
        doubt = self.whereabouts.problem
        reason, self.is_lost = self.broken or doubt, doubt is not None
        self._fault = f"cannot drive: {reason}" if reason is not None else None
        self.trouble = f"{self._robot.name} {self._fault}" if self._fault is not None else None
        self.tell_problem()

    def tell_problem(self, *, is_new: bool = False) -> None:
        """Have people told of its problem, if it has changed. `is_new`: anew."""
        absence: str | None = None
        if self.reach.silence is not None:
            absence = f"cannot be reached: {self.reach.silence}"
        elif self.complaint is not None:
            absence = f"takes no part in traffic: {self.complaint}"
        if is_new:
            self._problem.tell_anew()
        self._problem.renew(self._fault, absence)

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
            remark="; ".join(filter(None, (robot.remark, self.standstill.remark))) or None,
        )

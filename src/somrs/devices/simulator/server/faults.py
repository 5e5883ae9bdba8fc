"""Scheduled faults: after a delay in simulated time, after a distance of carrying something, or after releasing it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.link.lines import Break
from somrs.devices.simulator.server.carrying import CarriedDistance
from somrs.devices.simulator.server.simulation import Simulation
from somrs.errors import UsageError


@dataclass(slots=True)
class _PlannedFault:
    request: Break
    due_time: float
    """Earliest simulated time of the fault."""
    carried_distance: CarriedDistance = field(default_factory=CarriedDistance)
    released: bool = False
    """Whether the robot has held something since the request."""
    activity: str | None = None
    """The robot's activity when it last held something."""


class Schedule:
    """The scheduled faults of a simulation."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._planned: list[_PlannedFault] = []

    def add(self, request: Break) -> None:
        self._simulation.linked.check_fault(request.robot, request.fault)
        if request.released and request.carried is not None:
            raise UsageError("a fault can occur while something is carried or when it was released: give only one of the two")
        self._planned.append(_PlannedFault(request, self._simulation.time + (request.delay or 0.0)))

    def drop(self, robot: str, fault: Fault) -> None:
        """Cancel the scheduled faults of this kind for the robot."""
        self._planned = [
            planned_fault for planned_fault in self._planned if (planned_fault.request.robot, planned_fault.request.fault) != (robot, fault)
        ]

    def due(self) -> Iterator[tuple[str, Fault]]:
        """Remove and yield the faults that are due. Call it once per control period, so that driven distances are measured accurately."""
        for planned_fault in list(self._planned):
            if planned_fault.request.robot not in self._simulation.linked:
                self._planned.remove(planned_fault)
            elif self._simulation.time >= planned_fault.due_time and self._carried_enough(planned_fault) and self._released(planned_fault):
                self._planned.remove(planned_fault)
                yield planned_fault.request.robot, planned_fault.request.fault

    def _carried_enough(self, planned_fault: _PlannedFault) -> bool:
        if planned_fault.request.carried is None:
            return True
        metres = planned_fault.carried_distance.measure(self._simulation.state(planned_fault.request.robot))
        return metres is not None and metres >= planned_fault.request.carried

    def _released(self, planned_fault: _PlannedFault) -> bool:
        """Whether the robot has released what it held, has ended that activity, and has drawn its arm in."""
        if not planned_fault.request.released:
            return True
        robot = self._simulation.robots.get(planned_fault.request.robot)
        if robot is None:
            return False
        if robot.holding is not None:
            planned_fault.released, planned_fault.activity = True, robot.activity
            return False
        return planned_fault.released and (robot.activity is None or robot.activity != planned_fault.activity) and not robot.arm_out

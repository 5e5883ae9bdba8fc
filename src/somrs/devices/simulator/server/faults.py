"""Faults that are to happen later: after some simulated time, once a robot has carried something so far, or has released it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.link.lines import Break
from somrs.devices.simulator.server.simulation import Simulation
from somrs.errors import UsageError


@dataclass(slots=True)
class _Planned:
    wanted: Break
    at: float
    """Simulated time before which it does not happen."""
    holding: str | None = None
    last: tuple[float, float] = (0.0, 0.0)
    carried: float = 0.0
    released: bool = False
    """It has held something."""
    doing: str | None = None
    """What it did when it held that last."""


class Schedule:
    """The faults that are to happen in a simulation."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._planned: list[_Planned] = []

    def add(self, wanted: Break) -> None:
        if wanted.robot not in self._simulation.linked:
            raise UsageError(f"there is no robot {wanted.robot}; there are {', '.join(self._simulation.linked) or 'none'}")
        if wanted.released and wanted.carried is not None:
            raise UsageError("a fault is to happen while something is carried, or when it was released: say one of the two")
        self._planned.append(_Planned(wanted, self._simulation.time + (wanted.after or 0.0)))

    def drop(self, robot: str, fault: Fault) -> None:
        """Call off what was to happen to the robot."""
        self._planned = [one for one in self._planned if (one.wanted.robot, one.wanted.fault) != (robot, fault)]

    def due(self) -> Iterator[tuple[str, Fault]]:
        """What is to happen now. Asked once every control period, so that the way driven is measured well."""
        for one in list(self._planned):
            if one.wanted.robot not in self._simulation.linked:
                self._planned.remove(one)
            elif self._simulation.time >= one.at and self._carried_enough(one) and self._released(one):
                self._planned.remove(one)
                yield one.wanted.robot, one.wanted.fault

    def _carried_enough(self, one: _Planned) -> bool:
        if one.wanted.carried is None:
            return True
        state = self._simulation.state(one.wanted.robot)
        if state.holding is None or state.holding != one.holding:
            one.holding, one.carried = state.holding, 0.0
        else:
            one.carried += math.dist(one.last, (state.x, state.y))
        one.last = (state.x, state.y)
        return state.holding is not None and one.carried >= one.wanted.carried

    def _released(self, one: _Planned) -> bool:
        """Whether it has let go of what it held, is done with that, and has drawn its arm in."""
        if not one.wanted.released:
            return True
        robot = self._simulation.robots.get(one.wanted.robot)
        if robot is None:
            return False
        if robot.holding is not None:
            one.released, one.doing = True, robot.doing
            return False
        return one.released and (robot.doing is None or robot.doing != one.doing) and not robot.arm_out

"""The distance for which a robot carries an object: the time of scheduled faults and pictures."""

from __future__ import annotations

import math
from dataclasses import dataclass

from somrs.devices.simulator.link.commands import RobotState


@dataclass(slots=True)
class CarriedDistance:
    """The distance for which one robot has carried what it holds, or a lift the robot in it.

    Call `measure` once per control period, so that it is accurate.
    """

    _holding: str | None = None
    _position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    _metres: float = 0.0

    def measure(self, state: RobotState) -> float | None:
        """The distance in metres since the robot took what it holds; None while it holds nothing."""
        position = state.x, state.y, state.z or 0.0
        self._metres = self._metres + math.dist(self._position, position) if state.holding == self._holding else 0.0
        self._holding, self._position = state.holding, position
        return self._metres if state.holding is not None else None

"""Whether a robot does what it is told: its reports are compared with the velocities that it was told."""

from __future__ import annotations

import math
from collections import deque

from msgspec import Struct

from somrs.adapters.arcos.parameters import Parameters
from somrs.adapters.arcos.steering import Speeds

REACTION = 0.5
"""Seconds within which a robot begins to do what it is told, and its reports show it."""
PATIENCE = 0.5
"""Seconds for which it may be faster than that, one after the other: commands get lost, and one report may be wrong."""
GAP = 0.5
"""Seconds without a report after which the comparison begins anew."""
SPARE, TURNING_SPARE = 0.05, math.radians(8)
"""How much faster than told a robot may be, m/s and rad/s."""
BRAKING = 0.5
"""Share of the deceleration that it was told with which it has to brake at least."""


class Band(Struct, kw_only=True):
    """The velocities that are plausible, in either direction: standing is always, as something may be in the way."""

    least: float = 0.0
    most: float = 0.0

    def restart(self, velocity: float) -> None:
        self.least, self.most = min(velocity, 0.0), max(velocity, 0.0)

    def narrow(self, least: float, most: float, step: float) -> None:
        """Come nearer to what the robot was told, by one step at most; at once where that is faster."""
        self.least = min(least, self.least + step)
        self.most = max(most, self.most - step)

    def excess(self, velocity: float) -> float:
        return max(velocity - self.most, self.least - velocity)


class Obedience:
    """Follows one robot."""

    def __init__(self) -> None:
        self._told: deque[tuple[float, Speeds]] = deque()
        self._forward, self._turning = Band(), Band()
        self._report_time = -math.inf
        self._excess_time = 0.0

    def tell(self, speeds: Speeds, now: float) -> None:
        """The robot was told these velocities, at a time in seconds."""
        self._told.append((now, speeds))

    def update(self, motion: Speeds, parameters: Parameters, now: float) -> str | None:
        """Take in with which velocities the robot moves. Returns what it does against what it was told, for people; None if it obeys."""
        step, self._report_time = now - self._report_time, now
        if step > GAP:
            self._restart(motion)
            return None
        while len(self._told) > 1 and self._told[1][0] <= now - REACTION:
            self._told.popleft()
        told = [speeds for _, speeds in self._told]
        forward, turning = [0.0, *(speeds.forward for speeds in told)], [0.0, *(speeds.turning for speeds in told)]
        self._forward.narrow(min(forward), max(forward), BRAKING * parameters.acceleration * step)
        self._turning.narrow(min(turning), max(turning), BRAKING * parameters.turning_acceleration * step)
        is_too_fast = self._forward.excess(motion.forward) > SPARE or self._turning.excess(motion.turning) > TURNING_SPARE
        self._excess_time = self._excess_time + step if is_too_fast else 0.0
        if self._excess_time < PATIENCE:
            return None
        self._restart(motion)
        return f"it does not do what it is told, or reports late: it moves with {_words(motion)}, and was told {_words(told[-1])}"

    def _restart(self, motion: Speeds) -> None:
        self._forward.restart(motion.forward)
        self._turning.restart(motion.turning)
        self._excess_time = 0.0


def _words(speeds: Speeds) -> str:
    return f"{speeds.forward:.1f} m/s and {math.degrees(speeds.turning):.0f}°/s"

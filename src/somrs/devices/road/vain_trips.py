"""How often a robot has given up where it stands. Whoever cannot drive on from there cannot make room for others either."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable

from somrs.space.solids import Point

NEAR = 0.1
"""A robot that gives up this near to where it gave up before has not moved on, m."""
RETRY, LONGEST_RETRY = 10.0, 300.0
"""Seconds after which such a robot is asked again to make room: for the first time, and at most."""


class VainTrips:
    """Those of one robot, since it has moved."""

    def __init__(self) -> None:
        self._point: Point | None = None
        self._count = 0
        self.reason = ""
        """Why the robot has given up last; empty if it has moved on."""

    def add(self, point: Point, reason: str) -> float | None:
        """The robot has given up at a point, in metres. Returns for how long it is not asked to make room, s; None: it may try on."""
        self.reason = reason
        if self._point is None or math.dist(self._point, point) > NEAR:
            self._point, self._count = point, 0
            return None
        self._count += 1
        return float(min(RETRY * 2 ** (self._count - 1), LONGEST_RETRY))

    def is_over(self, point: Point) -> bool:
        """Whether a robot that is at this point now has moved away from where it has given up; then they are forgotten."""
        if self._point is None or math.dist(self._point, point) <= NEAR:
            return False
        self._point, self._count, self.reason = None, 0, ""
        return True


class Rest:
    """A time in which a robot is not asked to make room. `on_change`: is called when it begins, and when it ends."""

    def __init__(self, on_change: Callable[[], None]) -> None:
        self._on_change = on_change
        self._timer: asyncio.TimerHandle | None = None

    @property
    def is_on(self) -> bool:
        return self._timer is not None

    def begin(self, duration: float) -> None:
        """It lasts so many seconds from now."""
        self.end()
        self._timer = asyncio.get_running_loop().call_later(duration, self.end)
        self._on_change()

    def end(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
            self._on_change()

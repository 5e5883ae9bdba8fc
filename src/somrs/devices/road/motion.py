"""How long a robot of a make takes for its ways: from how it moves, and from how long it took for others. For quotes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from msgspec import Struct

from somrs.space.solids import Point

STRAIGHT = math.radians(15)
"""A robot does not stop at a place at which its way bends by less, rad."""
TURN = math.radians(90)
"""By how much a robot turns before it sets off, and when it has come to where it works, rad; nobody knows better when it is asked."""
TRIP = 2.0
"""Seconds until a trip is granted, and until it is clear at its end that the robot stands."""
SHARE = 0.3
"""Share of what was seen last in what is expected."""
LEAST, MOST = 0.5, 3.0
"""How many times as long as reckoned a robot may be expected to take. What takes longer has another cause, such as a lift that waits to be
mended."""
LONG_ENOUGH = 3.0
"""Seconds from which on a duration tells something."""


class Motion(Struct, frozen=True, kw_only=True):
    """How a robot moves, and handles things.

    `speed`: its largest, m/s; None: that of the map. `acceleration`: with which it sets off and stops, m/s². `turning`: its turning on the
    spot, rad/s; `settling`: what it loses at a place at which it turns, besides, s. `handling`: what it takes to pick a thing and to drop
    it, s. `rounds_corners`: it drives through corners, more slowly, and does not stop to turn there.
    """

    speed: float | None = None
    acceleration: float = 0.5
    turning: float = 1.0
    settling: float = 0.5
    handling: float = 20.0
    rounds_corners: bool = False

    def speed_on(self, map_speed: float) -> float:
        """The speed of a robot that has this one on the map, m/s."""
        return map_speed if self.speed is None else min(self.speed, map_speed)

    def detour(self, points: Sequence[Point], speed: float) -> float:
        """How much farther the robot would drive in the time for a way, if it did neither stop nor turn, m."""
        return self.time(points, speed) * speed - sum(math.dist(start, end) for start, end in pairwise(points))

    def time(self, points: Sequence[Point], speed: float) -> float:
        """Seconds for a way through points, in metres, at a largest speed, m/s: with its stops, and its turns; 0 for a way that is none."""
        headings = [
            (math.atan2(y - y0, x - x0), math.dist((x0, y0), (x, y))) for (x0, y0), (x, y) in pairwise(points) if (x0, y0) != (x, y)
        ]
        if not headings:
            return 0.0
        seconds, run, heading = TRIP + 2 * self._turn(TURN), 0.0, headings[0][0]
        for next_heading, length in headings:
            bend = abs(math.remainder(next_heading - heading, math.tau))
            if self.rounds_corners:
                seconds += self._corner(bend, speed)
            elif bend >= STRAIGHT:
                seconds, run = seconds + self._run(run, speed) + self._turn(bend), 0.0
            run, heading = run + length, next_heading
        return seconds + self._run(run, speed)

    def _run(self, length: float, speed: float) -> float:
        """Seconds for a straight run that begins and ends with a stop."""
        ramps = speed**2 / self.acceleration
        return length / speed + speed / self.acceleration if length >= ramps else 2 * math.sqrt(length / self.acceleration)

    def _corner(self, bend: float, speed: float) -> float:
        """Seconds lost by slowing down for a corner, where the robot is as fast as its turn allows."""
        slowed = speed * (1.0 - max(0.0, math.cos(bend)) ** 2)
        return slowed**2 / (speed * self.acceleration)

    def _turn(self, angle: float) -> float:
        return angle / self.turning + self.settling


class Experience:
    """How long a robot took, for what was reckoned."""

    def __init__(self) -> None:
        self.ratio = 1.0
        """How many times as long as reckoned it is expected to take."""

    def learn(self, reckoned: float, taken: float) -> None:
        """It took so many seconds, and so many were reckoned, without experience."""
        if reckoned >= LONG_ENOUGH:
            self.ratio += SHARE * (min(max(taken / reckoned, LEAST), MOST) - self.ratio)

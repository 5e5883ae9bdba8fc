"""The time of the world in which the devices work: the wall's, or that of a simulation, which may be faster or slower, or stand still.
Deadlines are in the world's time.
"""

from __future__ import annotations

from msgspec import Struct


class WorldTimePassed(Struct, frozen=True, kw_only=True, tag=True):
    """`seconds` have passed in the world since the last such notice. From now on, `rate` seconds pass in it in each second."""

    seconds: float
    rate: float


class WorldClock(Struct, kw_only=True):
    """The world's time in seconds, from any origin. `wall`: seconds since 1970 at the last notice; `time`: the world's time then."""

    wall: float = 0.0
    time: float = 0.0
    rate: float = 1.0

    def adjust(self, notice: WorldTimePassed, wall: float) -> None:
        """Record the world's time at a time of the wall's clock."""
        self.time += notice.seconds
        self.wall, self.rate = wall, notice.rate

    def time_at(self, wall: float) -> float:
        """The world's time at a time of the wall's clock, if it goes on as it does now."""
        return self.time + (wall - self.wall) * self.rate

    def wall_time(self, time: float) -> float | None:
        """When this time comes in the world, if that goes on as it does now; None: it stands still before."""
        ahead = time - self.time
        if ahead > 0 and self.rate <= 0:
            return None
        return self.wall + max(ahead, 0.0) / (self.rate or 1.0)

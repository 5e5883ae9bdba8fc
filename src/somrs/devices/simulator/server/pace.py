"""Notices when simulated time passes more slowly than it should, because the processor is too slow for the world."""

from __future__ import annotations

from dataclasses import dataclass

WINDOW = 30.0
"""Seconds of real time over which the pace is measured."""
TOO_SLOW = 0.7
"""Part of the simulated time of a window that has to pass."""


@dataclass(slots=True)
class Pace:
    """The pace of a simulation that should run at `speed`: simulated seconds per second."""

    speed: float
    _start: tuple[float, float] | None = None
    """The real and the simulated time at the start of the window."""
    _was_slow: bool = False

    def measure(self, now: float, simulated: float) -> float | None:
        """The speed of the window that is over, if it is the first one that is too slow; None otherwise. Times are in seconds."""
        if self._start is None:
            self._start = now, simulated
        start_time, origin = self._start
        if now - start_time < WINDOW:
            return None
        actual_speed = (simulated - origin) / (now - start_time)
        is_news = actual_speed < TOO_SLOW * self.speed and not self._was_slow
        self._was_slow = actual_speed < TOO_SLOW * self.speed
        self._start = now, simulated
        return actual_speed if is_news else None

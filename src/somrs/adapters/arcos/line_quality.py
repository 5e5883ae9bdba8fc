"""How much of what a robot sends arrives damaged."""

from __future__ import annotations

SPAN = 30.0
"""Seconds over which it is counted."""
LEAST = 1000
"""Bytes below which nothing is said: a robot that reports sends several times as many in that time."""
LIMIT = 0.01
"""Share from which on people are told."""


class LineQuality:
    """Counts the bytes of one line. `share`: of damaged bytes in the last span, from 0 to 1; None before the first has ended."""

    def __init__(self) -> None:
        self.share: float | None = None
        self._start: float | None = None
        self._bytes = self._intact = 0

    def count(self, received: int, intact: int, now: float) -> None:
        """So many bytes have come, of which so many were of intact packets."""
        self._start = now if self._start is None else self._start
        self._bytes, self._intact = self._bytes + received, self._intact + intact
        if now - self._start < SPAN:
            return
        if self._bytes >= LEAST:
            self.share = max(0.0, 1.0 - self._intact / self._bytes)
        self._start, self._bytes, self._intact = now, 0, 0

    @property
    def is_poor(self) -> bool:
        return self.share is not None and self.share >= LIMIT

"""The one clock of a process."""

from __future__ import annotations

import time


class Clock:
    """Seconds since 1970 that never go back while the process lives, nor before what a journal holds."""

    def __init__(self) -> None:
        self._offset = time.time() - time.monotonic()

    def now(self) -> float:
        return time.monotonic() + self._offset

    def not_before(self, at: float) -> None:
        """Go on from there at least: the machine's clock was put back since."""
        self._offset += max(0.0, at - self.now())

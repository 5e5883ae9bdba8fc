"""The clock of a process."""

from __future__ import annotations

import os
import time
from zoneinfo import ZoneInfo


class Clock:
    """Seconds since 1970. The clock never goes back during the life of the process, nor behind the time in a journal."""

    def __init__(self) -> None:
        self._offset = time.time() - time.monotonic()

    def now(self) -> float:
        return time.monotonic() + self._offset

    def advance_to(self, timestamp: float) -> None:
        """Advance the clock to this time at least: the machine's clock may have been put back."""
        self._offset += max(0.0, timestamp - self.now())


class TimeOfDay(Clock):
    """The machine's time of day. It follows a clock that is put forward, and stands still while a clock that was put back is behind."""

    def __init__(self) -> None:
        super().__init__()
        self._latest = 0.0

    def now(self) -> float:
        self._latest = max(self._latest, time.time())
        return self._latest

    def advance_to(self, timestamp: float) -> None:
        self._latest = max(self._latest, timestamp)


def local_zone() -> str:
    """Return the machine's zone in the time zone database, such as `Europe/Berlin`; empty if it is unknown."""
    named = os.environ.get("TZ")
    name = named.removeprefix(":") if named is not None else os.path.realpath("/etc/localtime").partition("/zoneinfo/")[2]
    try:
        return ZoneInfo(name).key
    except (KeyError, ValueError, OSError):
        return ""

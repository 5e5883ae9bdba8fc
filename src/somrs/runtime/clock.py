"""The one clock of a process."""

from __future__ import annotations

import os
import time
from zoneinfo import ZoneInfo


class Clock:
    """Seconds since 1970 that never go back while the process lives, nor before what a journal holds."""

    def __init__(self) -> None:
        self._offset = time.time() - time.monotonic()

    def now(self) -> float:
        return time.monotonic() + self._offset

    def advance_to(self, timestamp: float) -> None:
        """Go on from there at least: the machine's clock was put back since."""
        self._offset += max(0.0, timestamp - self.now())


class TimeOfDay(Clock):
    """The machine's time of day, also after it was put forward, or the machine slept; while it is put back, it stands still."""

    def __init__(self) -> None:
        super().__init__()
        self._latest = 0.0

    def now(self) -> float:
        self._latest = max(self._latest, time.time())
        return self._latest

    def advance_to(self, timestamp: float) -> None:
        self._latest = max(self._latest, timestamp)


def local_zone() -> str:
    """The name of the machine's zone in the time zone database, such as `Europe/Berlin`; empty where that cannot be told."""
    named = os.environ.get("TZ")
    name = named.removeprefix(":") if named is not None else os.path.realpath("/etc/localtime").partition("/zoneinfo/")[2]
    try:
        return ZoneInfo(name).key
    except (KeyError, ValueError, OSError):
        return ""

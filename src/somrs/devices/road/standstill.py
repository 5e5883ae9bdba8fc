"""How long a robot stands that is to drive. Nobody concludes from it that the robot is broken: people are told, and see to it.

Without I/O and clock.
"""

from __future__ import annotations

import logging
import math

log = logging.getLogger(__name__)

NOTABLE = {900.0: "15 minutes", 300.0: "5 minutes", 60.0: "a minute", 20.0: "20 seconds"}
"""For how long it stands when people are told so, s, the longest first."""


class Standstill:
    """That of one robot."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._start_time: float | None = None
        self.remark: str | None = None
        """How long it stands although it may drive, for people; None: it drives, or has not stood for long."""

    def update(self, *, may_drive: bool, rest_time: float, now: float) -> None:
        """`may_drive`: it has somewhere to go, and traffic lets it; `rest_time`: since when it is where it is, s."""
        if not may_drive:
            self._start_time = None
        elif self._start_time is None:
            self._start_time = now
        elif math.isfinite(rest_time):
            self._start_time = max(self._start_time, rest_time)
        duration = now - self._start_time if self._start_time is not None else 0.0
        words = next((text for seconds, text in NOTABLE.items() if duration >= seconds), None)
        remark = f"has not moved for {words}, although it may drive on" if words is not None else None
        if remark is not None and self.remark is None:
            log.warning("%s %s", self._name, remark)
        self.remark = remark

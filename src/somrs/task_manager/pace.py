"""How late everybody is: the delays of recent answers, heartbeats and works.

Time limits follow them. A limit is never shorter than on an idle system; when the typical participant is late, because a machine is busy or
the network is slow, it is longer for all. So one silent device stands out, and a slow system is not taken for many silent devices.
"""

from __future__ import annotations

from statistics import median_low

from msgspec import Struct

REMEMBERED = 49
"""The number of recent values of each kind. The typical one is their median, which a single slow device does not move."""

LEAST_VALUES = 3
"""Fewer values say nothing about the others."""

MANY_TIMES = 4.0
"""A participant counts as silent after so many times the typical delay."""


class Pace(Struct, kw_only=True):
    """Recent values, the latest last.

    `answers`: seconds from Arrange to its answer. `intervals`: seconds between two messages of a working participant. `slowness`: how many
    times longer than promised completed work took.
    """

    answers: list[float] = []
    intervals: list[float] = []
    slowness: list[float] = []

    def answered(self, seconds: float) -> None:
        """Record the delay of an answer to Arrange."""
        _record(self.answers, seconds)

    def heard(self, seconds: float) -> None:
        """Record the time since the previous message of a working participant."""
        _record(self.intervals, seconds)

    def completed(self, seconds: float, promised: float) -> None:
        """Record the time that work took, and the time that its terms promised."""
        if promised > 0.0:
            _record(self.slowness, seconds / promised)

    def answer_time(self, least: float) -> float:
        """Seconds to wait for an answer to Arrange, at least `least`."""
        return max(least, MANY_TIMES * _typical(self.answers))

    def silence(self, least: float) -> float:
        """Seconds without a message after which a working participant is silent, at least `least`."""
        # Heartbeats come often enough that a few may be lost: `least` is several intervals.
        return max(least, (MANY_TIMES - 1) * _typical(self.intervals))

    def stretch(self, seconds: float) -> float:
        """The time for work, longer if the work of others takes longer than promised."""
        return seconds * max(1.0, _typical(self.slowness))


def _record(values: list[float], value: float) -> None:
    values.append(round(value, 3))
    del values[:-REMEMBERED]


def _typical(values: list[float]) -> float:
    return median_low(values) if len(values) >= LEAST_VALUES else 0.0

"""When a device is free, given what it is committed to."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from heapq import heappop, heappush

Commitment = tuple[float, float]
"""From when until when, in seconds."""


def resolve_overlaps(commitments: Iterable[Commitment], capacity: int) -> list[Commitment]:
    """When they can really be kept: terms that were given at the same time may promise the same time, and a device does so many things at
    once, whatever it promised; the earliest first."""
    free_times = [float("-inf")] * capacity
    schedule: list[Commitment] = []
    for start, end in sorted(commitments):
        begins = max(start, heappop(free_times))
        heappush(free_times, begins + end - start)
        schedule.append((begins, begins + end - start))
    return schedule


def first_free_time(commitments: Iterable[Commitment], earliest: float, duration: float, capacity: int) -> float:
    """The first time, not before `earliest`, from which the device has room for something that lasts `duration`."""
    start = earliest
    for begins, ends in _busy_periods(commitments, capacity):
        if begins < start + duration and ends > start:
            start = ends
    return start


def _busy_periods(commitments: Iterable[Commitment], capacity: int) -> Iterator[Commitment]:
    """From when until when there is no room at all, in order."""
    changes = sorted(change for begins, ends in commitments if ends > begins for change in ((begins, 1), (ends, -1)))
    busy, start = 0, 0.0
    for time, change in changes:
        if busy < capacity <= busy + change:
            start = time
        elif busy + change < capacity <= busy and time > start:
            yield start, time
        busy += change

"""The times at which a device is free, given its commitments."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from heapq import heappop, heappush

Commitment = tuple[float, float]
"""Start and end, in seconds."""


def resolve_overlaps(commitments: Iterable[Commitment], capacity: int) -> list[Commitment]:
    """Return the times at which the commitments can be kept, the earliest first.

    Terms that were given at the same time may promise the same time; a device performs at most `capacity` services at once.
    """
    free_times = [float("-inf")] * capacity
    schedule: list[Commitment] = []
    for start, end in sorted(commitments):
        begins = max(start, heappop(free_times))
        heappush(free_times, begins + end - start)
        schedule.append((begins, begins + end - start))
    return schedule


def first_free_time(commitments: Iterable[Commitment], earliest: float, duration: float, capacity: int) -> float:
    """Return the first time, not before `earliest`, from which the device has free capacity for `duration` seconds."""
    start = earliest
    for begins, ends in _busy_periods(commitments, capacity):
        if begins < start + duration and ends > start:
            start = ends
    return start


def _busy_periods(commitments: Iterable[Commitment], capacity: int) -> Iterator[Commitment]:
    """Yield the periods without free capacity, in order."""
    changes = sorted(change for begins, ends in commitments if ends > begins for change in ((begins, 1), (ends, -1)))
    busy, start = 0, 0.0
    for time, change in changes:
        if busy < capacity <= busy + change:
            start = time
        elif busy + change < capacity <= busy and time > start:
            yield start, time
        busy += change

"""When a device is free, given what it is committed to."""

from __future__ import annotations

from collections.abc import Sequence

Commitment = tuple[float, float]
"""From when until when, in seconds."""


def free_from(commitments: Sequence[Commitment], earliest: float, duration: float, capacity: int) -> float:
    """The first time, not before `earliest`, from which the device has room for something that lasts `duration`.

    Room changes only where a commitment ends, so these are the only times to try besides `earliest`.
    """
    if len(commitments) < capacity:
        return earliest
    starts = sorted({earliest, *(end for _, end in commitments if end > earliest)})
    return next(start for start in starts if _most_at_once(commitments, start, start + duration) < capacity)


def _most_at_once(commitments: Sequence[Commitment], start: float, end: float) -> int:
    """How many commitments overlap at the busiest moment between two times."""
    inside = [(max(a, start), min(b, end)) for a, b in commitments if a < end and b > start]
    return max((sum(a <= moment < b for a, b in inside) for moment, _ in inside), default=0)

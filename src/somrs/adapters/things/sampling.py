"""Decides which readings are news for the map, and when: dead bands, shortest times between reports, reports of many things at once."""

from __future__ import annotations

import math
from collections.abc import Iterable

from msgspec import Struct

from somrs.ontology.types import Value

Key = tuple[str, str]
"""The name of an object, and the path of an attribute."""


class Sample(Struct, kw_only=True):
    """An attribute: what the map was told, and when; what it is to be told. `reported` None: nothing."""

    reported: Value | None = None
    reported_at: float = -math.inf


class Pending(Struct, frozen=True, kw_only=True):
    """A value of which the map is to be told, from a time on. None: that there is none any more."""

    value: Value | None
    due: float


class Sampler:
    """The readings of which the map is to be told. Times are in seconds from any start.

    Of a value that changes and comes back before its report is due, the map learns nothing.
    """

    def __init__(self) -> None:
        self._samples: dict[Key, Sample] = {}
        self._pending: dict[Key, Pending] = {}

    def offer(self, key: Key, value: Value | None, now: float, *, dead_band: float = 0.0, interval: float = 0.0) -> None:
        """A value was read. None: it is not known any more."""
        sample = self._samples.get(key)
        if sample is None:
            sample = self._samples[key] = Sample()
        if _is_same(value, sample.reported, dead_band):
            self._pending.pop(key, None)
        else:
            due, pending = max(now, sample.reported_at + interval), self._pending.get(key)
            if pending is None or pending.value != value or pending.due > due:  # the same news waits no longer
                self._pending[key] = Pending(value=value, due=due)

    def take_due(self, now: float, objects: Iterable[str] | None = None, limit: int = 100) -> dict[Key, Value | None]:
        """The values that are to be reported now, at most so many, as if they were reported: those of the `objects`, if given."""
        wanted_objects = frozenset(objects) if objects is not None else None
        due: dict[Key, Value | None] = {}
        for key, pending in self._pending.items():
            if len(due) == limit:
                break
            if pending.due <= now and (wanted_objects is None or key[0] in wanted_objects):
                due[key] = pending.value
        for key, value in due.items():
            del self._pending[key]
            self.note(key, value, now)
        return due

    def note(self, key: Key, value: Value | None, now: float) -> None:
        """The map knows the value; None: it has none."""
        sample = self._samples.setdefault(key, Sample())
        if (pending := self._pending.get(key)) is not None and pending.value == value:
            del self._pending[key]
        sample.reported, sample.reported_at = value, now

    def next_due(self) -> float | None:
        """When something is to be reported; None: nothing is."""
        return min((pending.due for pending in self._pending.values()), default=None)

    def pending_objects(self) -> set[str]:
        """The objects of which there is something to report."""
        return {name for name, _ in self._pending}

    def drop(self, name: str) -> None:
        """Forget an object, which has gone."""
        for key in [key for key in self._samples if key[0] == name]:
            del self._samples[key]
            self._pending.pop(key, None)


def _is_same(value: Value | None, reported: Value | None, dead_band: float) -> bool:
    if isinstance(value, bool) or isinstance(reported, bool) or not (isinstance(value, float) and isinstance(reported, float)):
        return value == reported and type(value) is type(reported)
    return abs(value - reported) <= dead_band

"""How often the same was denied to the same sender, so that whoever tries again and again does not fill the disk with records of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable

MOST_DENIALS = 1000
"""How many different denials are counted."""


class DenialCounts:
    """Counts denials. The first one is worth a record, and then each tenth, hundredth and so on."""

    def __init__(self) -> None:
        self._counts: Counter[Hashable] = Counter()

    def add(self, denial: Hashable) -> int | None:
        """Count a denial: who was denied what. Returns how often that was so far, if it is worth a record; None if it is not."""
        if denial not in self._counts and len(self._counts) >= MOST_DENIALS:
            self._counts.clear()
        self._counts[denial] += 1
        count = self._counts[denial]
        return count if count == 10 ** (len(str(count)) - 1) else None

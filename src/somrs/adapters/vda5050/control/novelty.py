"""What is told once about a vehicle: one that says something else each time must not fill the memory, or the log."""

from __future__ import annotations

MOST = 200
"""How many things are told of one kind, about one vehicle."""


class Novelty:
    """The words of one kind that were told about one vehicle."""

    def __init__(self) -> None:
        self._told: set[str] = set()

    def is_new(self, words: str) -> bool:
        """Whether something is to be told: it was not, and there is not too much already. Notes it."""
        if words in self._told or len(self._told) >= MOST:
            return False
        self._told.add(words)
        return True

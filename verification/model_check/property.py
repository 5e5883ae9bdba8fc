"""The names of the properties. `properties.py` defines them."""

from __future__ import annotations

from enum import StrEnum


class Property(StrEnum):
    """The properties, in the order in which they are printed."""

    VALID_STATE = "no invalid state"
    MUTUAL_EXCLUSION = "1 mutual exclusion"
    CONTRACT = "2 no work without a contract"
    TERMINATION = "3 termination"
    PARTIAL_RESULT = "4 no silent partial result"
    ORPHAN = "6 no orphan"
    RESTART = "7 restart transparency"
    CONDITION = "8 conditions"
    INVARIANT = "9 while"
    REFUSAL = "10 not now"
    RECOGNITION = "11 recognition"

    @property
    def number(self) -> str:
        """Its number; empty for the first, which has none."""
        first, _, _ = self.value.partition(" ")
        return first if first.isdigit() else ""

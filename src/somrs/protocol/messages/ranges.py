"""The ranges of the numbers in messages, and the length of their texts. Types say what is a number; this says which ones make sense.

They are checked where a message arrives, and not in the types, so that what is in a journal can always be read.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple

from msgspec import Struct

from somrs.errors import UsageError


class Range(NamedTuple):
    """The numbers from `least` to `greatest`."""

    least: float
    greatest: float


INDEX = Range(0, 1e15)
"""A position in a list, a version, or a number of something."""
SECONDS = Range(0, 1e9)
"""A duration of up to some 30 years."""
ANY = Range(-1e15, 1e15)
"""Every other number. Sums and products of such numbers are finite, and exact enough."""

RANGES: Mapping[str, Range] = {
    "limit": Range(0, 1e6),
    "skip": Range(0, 1e9),
    "after": INDEX,
    "at_version": INDEX,
    "before": INDEX,
    "contracts": INDEX,
    "fence": INDEX,
    "messages": INDEX,
    "parts": INDEX,
    "progress": INDEX,
    "serial": INDEX,
    "version": INDEX,
    "delay": SECONDS,
    "deadline": Range(1e-3, 1e9),
    "duration": SECONDS,
    "lease": Range(1e-3, 1e9),
    "minutes": Range(1e-3, 1e9),
    "penalty": Range(0, 1e12),
    "price": Range(0, 1e12),
    "priority": Range(-1e9, 1e9),
    "radius": Range(0, 1e6),
    "time_value": Range(0, 1e9),
    "wait": Range(0, 3600),
    "width": Range(1, 10_000),
}
"""Ranges by the name of the field or parameter; all others have `ANY`."""

LONGEST_TEXT = 256 * 1024
"""Characters of one text, such as a formula: no more than a message has bytes."""

FILES = frozenset((("ImportOntology", "text"),))
"""Texts that are whole files. Only the size of the request limits them."""

DEEPEST = 32
"""Structures inside each other."""


def check_ranges(value: object, name: str = "", depth: int = 0) -> None:
    """Check all numbers and texts in a value that has arrived. `name`: that of the value. Raises UsageError."""
    match value:
        case bool() | None | Enum():
            return
        case int() | float():
            range = RANGES.get(name.rpartition(".")[2], ANY)
            if not range.least <= value <= range.greatest:
                number = str(value) if abs(value) < 1e18 or isinstance(value, float) else "a larger number"
                raise UsageError(f"{name} is {number}; give a number from {range.least:g} to {range.greatest:g}")
        case str():
            if len(value) > LONGEST_TEXT:
                raise UsageError(f"{name or 'a text'} has {len(value)} characters; {LONGEST_TEXT} is the limit")
        case Struct() | tuple() | list() | dict() | frozenset() if depth > DEEPEST:
            raise UsageError(f"{name} is nested more than {DEEPEST} deep")
        case Struct():
            for field in value.__struct_fields__:
                if (type(value).__name__, field) in FILES:
                    continue
                check_ranges(getattr(value, field), f"{name}.{field}" if name else field, depth + 1)
        case dict():
            for key, entry in value.items():
                check_ranges(key, name, depth + 1)
                check_ranges(entry, f"{name}[{str(key)[:60]}]", depth + 1)
        case tuple() | list() | frozenset():
            for entry in value:
                check_ranges(entry, name, depth + 1)

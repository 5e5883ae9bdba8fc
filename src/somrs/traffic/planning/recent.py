"""What was used last of what takes long to find: on large buildings, all of it would fill the memory."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import TypeVar

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")


def recall(values: dict[Key, Value], key: Key, find: Callable[[], Value], most: int) -> Value:
    """The value for the key, or the one that is found for it. Of the others, those that were used last are kept, at most so many."""
    if key in values:
        values[key] = values.pop(key)
        return values[key]
    value = find()
    while len(values) >= most:
        del values[next(iter(values))]
    values[key] = value
    return value

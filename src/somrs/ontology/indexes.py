"""The indexes of a map, which the maps derived from it share."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Iterator
from typing import Generic, TypeVar

K = TypeVar("K", bound=Hashable)
T = TypeVar("T", bound=Hashable)


MAX_OWN_KEYS = 256
"""A copy merges its own keys into the shared ones when it has more own keys than this."""


class Index(Generic[K, T]):
    """Maps each key to its things, in the order of insertion.

    A copy shares the data of the original, and stores only the keys that were changed since (copy on write).
    """

    __slots__ = ("_changed", "_own_keys", "_shared")

    def __init__(self, pairs: Iterable[tuple[K, T]] = ()) -> None:
        self._shared: dict[K, dict[T, None]] = {}
        self._changed: dict[K, dict[T, None]] = {}
        self._own_keys: set[K] = set()
        for key, thing in pairs:
            self._shared.setdefault(key, {})[thing] = None

    def values_for(self, key: K) -> Collection[T]:
        changed = self._changed.get(key)
        return changed if changed is not None else self._shared.get(key, ())

    def keys(self) -> Iterator[K]:
        yield from (key for key in self._shared if key not in self._changed)
        yield from (key for key, things in self._changed.items() if things)

    def copy(self) -> Index[K, T]:
        """A copy. Changes of the copy do not affect this index."""
        new_index: Index[K, T] = Index()
        if len(self._changed) > MAX_OWN_KEYS:
            merged_things = {**self._shared, **self._changed}
            new_index._shared = {key: things for key, things in merged_things.items() if things}
        else:
            new_index._shared, new_index._changed = self._shared, dict(self._changed)
        return new_index

    def add(self, key: K, thing: T) -> None:
        self._to_change(key)[thing] = None

    def remove(self, key: K, thing: T) -> None:
        self._to_change(key).pop(thing, None)

    def _to_change(self, key: K) -> dict[T, None]:
        if key not in self._own_keys:
            self._changed[key] = dict.fromkeys(self.values_for(key))
            self._own_keys.add(key)
        return self._changed[key]

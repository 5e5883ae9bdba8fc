"""Where to find things by a key without walking through all of them. A map's indexes, which its successors share."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Iterator
from typing import Generic, TypeVar

K = TypeVar("K", bound=Hashable)
T = TypeVar("T", bound=Hashable)


MAX_OWN_KEYS = 256
"""With more keys than this of their own, copies put them together with what they share."""


class Index(Generic[K, T]):
    """The things under each key, in the order in which they came.

    A copy shares what it was made of, and has of its own what is under the keys that were changed since.
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
        """Another one, which may be changed while this one stays."""
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

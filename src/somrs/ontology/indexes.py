"""Where to find things by a key without walking through all of them. A map's indexes, which its successors share."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable
from typing import Generic, TypeVar

K = TypeVar("K", bound=Hashable)
T = TypeVar("T", bound=Hashable)


class Index(Generic[K, T]):
    """The things under each key, in the order in which they came.

    A copy costs as much as there are keys; what stands under a key is copied when it is first changed.
    """

    __slots__ = ("_by_key", "_own")

    def __init__(self, pairs: Iterable[tuple[K, T]] = ()) -> None:
        self._by_key: dict[K, dict[T, None]] = {}
        self._own: set[K] = set()
        for key, thing in pairs:
            self._by_key.setdefault(key, {})[thing] = None

    def under(self, key: K) -> Collection[T]:
        return self._by_key.get(key, ())

    def keys(self) -> Iterable[K]:
        return self._by_key.keys()

    def copy(self) -> Index[K, T]:
        """Another one, which may be changed while this one stays."""
        made: Index[K, T] = Index()
        made._by_key = dict(self._by_key)
        return made

    def add(self, key: K, thing: T) -> None:
        self._owned(key)[thing] = None

    def remove(self, key: K, thing: T) -> None:
        things = self._owned(key)
        things.pop(thing, None)
        if not things:
            del self._by_key[key]

    def _owned(self, key: K) -> dict[T, None]:
        if key not in self._own:
            self._by_key[key] = dict(self._by_key.get(key, ()))
            self._own.add(key)
        return self._by_key.setdefault(key, {})

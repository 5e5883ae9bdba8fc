"""The indexes of a map, which the maps derived from it share."""

from __future__ import annotations

from bisect import insort
from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, MutableMapping
from typing import Any, Generic, TypeVar

from somrs.ontology.paged import PagedDict, mutable_copy, settled

K = TypeVar("K", bound=Hashable)
T = TypeVar("T", bound=Hashable)

FEW = 8
"""So many things of one key are a tuple, which takes a quarter of the memory of a dict."""


class Index(Generic[K, T]):
    """Maps each key to its things. `is_sorted`: in the order of both, as those of a large mapping are; otherwise in the order of insertion.

    A copy shares the data of the original, except for the keys that were changed since.
    """

    __slots__ = ("_groups", "_is_sorted", "_own_keys")

    def __init__(self, pairs: Iterable[tuple[K, T]] = (), is_sorted: bool = False) -> None:
        groups: dict[K, dict[T, None] | tuple[T, ...]] = {}
        for key, thing in pairs:
            things = groups.get(key, ())
            if isinstance(things, tuple) and len(things) < FEW:
                groups[key] = (*things, thing)
            else:
                groups[key] = things = dict.fromkeys(things) if isinstance(things, tuple) else things
                things[thing] = None
        self._is_sorted = is_sorted
        self._groups: Mapping[K, Collection[T]] = settled({key: self._grouped(things) for key, things in groups.items()})
        self._own_keys: set[K] = set()
        """The keys whose things, in a mapping, no copy has."""

    def _grouped(self, things: Collection[T]) -> Collection[T]:
        """The things of a key in the form for their number."""
        if len(things) <= FEW:
            few: list[Any] = list(things)
            return tuple(sorted(few) if self._is_sorted else few)
        if isinstance(things, Mapping):
            things = settled(things)
        if self._is_sorted and isinstance(things, dict):
            return dict.fromkeys(sorted(things))
        return things

    def values_for(self, key: K) -> Collection[T]:
        return self._groups.get(key, ())

    def keys(self) -> Iterator[K]:
        keys: Any = self._groups
        yield from sorted(keys) if self._is_sorted and not isinstance(keys, PagedDict) else keys

    def copy(self) -> Index[K, T]:
        """A copy. Changes of the copy do not affect this index."""
        copy: Index[K, T] = Index.__new__(Index)
        copy._groups, copy._is_sorted, copy._own_keys = mutable_copy(self._groups), self._is_sorted, set()
        return copy

    def add(self, key: K, thing: T) -> None:
        """Add a thing that the key does not have. Only a copy may be changed."""
        things = self._groups.get(key, ())
        if isinstance(things, tuple) and len(things) < FEW:
            few: list[Any] = [*things]
            insort(few, thing) if self._is_sorted else few.append(thing)
            self._set(key, tuple(few))
            return
        mapping = self._own_things(key, things)
        mapping[thing] = None
        self._set(key, self._grouped(mapping))

    def remove(self, key: K, thing: T) -> None:
        """Remove a thing of the key, if it has it. Only a copy may be changed."""
        things = self._groups.get(key, ())
        if isinstance(things, tuple):
            self._set(key, tuple(other for other in things if other != thing))
        elif thing in things:
            mapping = self._own_things(key, things)
            del mapping[thing]
            self._set(key, self._grouped(mapping))

    def _own_things(self, key: K, things: Collection[T]) -> MutableMapping[T, None]:
        if not isinstance(things, MutableMapping):
            self._own_keys.add(key)
            return dict.fromkeys(things)
        if key not in self._own_keys:
            self._own_keys.add(key)
            return mutable_copy(things)
        return things

    def _set(self, key: K, things: Collection[T]) -> None:
        assert isinstance(self._groups, MutableMapping)
        if things:
            self._groups[key] = things
        else:
            self._groups.pop(key, None)

    def settle(self) -> None:
        """End the changes of a copy."""
        self._groups = settled(self._groups)

"""The index of where the objects of a map are, by squares of the floor, to find what is near a point without a look at the rest."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Protocol

from somrs.ontology.indexes import Index
from somrs.ontology.types import Value

X, Y = "PositionX", "PositionY"

_Square = tuple[int, int]
"""The whole parts of both coordinates, in the unit of the attributes."""


class Object(Protocol):
    """What an index reads of an object of the map."""

    @property
    def name(self) -> str: ...

    @property
    def type(self) -> str: ...

    @property
    def values(self) -> Mapping[str, Value]: ...


class PlaceIndex:
    """Which objects state a position in which square, and which objects of a type state none. Copies share what is unchanged."""

    def __init__(self, objects: Iterable[Object]) -> None:
        squares: list[tuple[_Square, str]] = []
        unplaced: list[tuple[str, str]] = []
        for object in objects:
            if (square := _square(object)) is not None:
                squares.append((square, object.name))
            else:
                unplaced.append((object.type, object.name))
        self._by_square, self._unplaced = Index(squares, is_sorted=True), Index(unplaced, is_sorted=True)

    def near(self, x: float, y: float, reach: float) -> Iterator[str]:
        """The objects in the squares that are no farther than `reach` from the point."""
        for column in range(math.floor(x - reach), math.floor(x + reach) + 1):
            for row in range(math.floor(y - reach), math.floor(y + reach) + 1):
                yield from self._by_square.values_for((column, row))

    def unplaced(self, type_name: str) -> Iterable[str]:
        """The objects of exactly this type that state no position."""
        return self._unplaced.values_for(type_name)

    def changed(self, changed_objects: Iterable[tuple[Object | None, Object | None]]) -> PlaceIndex:
        """The index after changes of objects: each as it was, and as it is."""
        index = PlaceIndex.__new__(PlaceIndex)
        index._by_square, index._unplaced = self._by_square.copy(), self._unplaced.copy()
        for old, new in changed_objects:
            if old is not None:
                index._remove(old)
            if new is not None:
                index._add(new)
        index._by_square.settle()
        index._unplaced.settle()
        return index

    def _add(self, object: Object) -> None:
        if (square := _square(object)) is not None:
            self._by_square.add(square, object.name)
        else:
            self._unplaced.add(object.type, object.name)

    def _remove(self, object: Object) -> None:
        if (square := _square(object)) is not None:
            self._by_square.remove(square, object.name)
        else:
            self._unplaced.remove(object.type, object.name)


def _square(object: Object) -> _Square | None:
    x, y = object.values.get(X), object.values.get(Y)
    if not isinstance(x, int | float) or not isinstance(y, int | float) or not math.isfinite(x) or not math.isfinite(y):
        return None
    return math.floor(x), math.floor(y)

"""Finds what is near a place without looking at everything: by the squares of the floor."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Generic, TypeVar

from somrs.space.solids import Point

Box = tuple[float, float, float, float]
"""A rectangle: its least and its largest x and y, as left, bottom, right and top, m."""

Item = TypeVar("Item")


def box_around(point: Point, span: float) -> Box:
    """The square whose sides are `span` away from a point."""
    return point[0] - span, point[1] - span, point[0] + span, point[1] + span


class Squares(Generic[Item]):
    """Items by the squares of this size, in metres, that they may be in."""

    def __init__(self, size: float) -> None:
        self._size = size
        self._items: dict[tuple[int, int], list[Item]] = {}

    def add(self, item: Item, box: Box) -> None:
        """Add an item that is somewhere in a rectangle."""
        for square in self._met(box):
            self._items.setdefault(square, []).append(item)

    def near(self, box: Box) -> Iterator[Item]:
        """The items in the squares that a rectangle meets. An item in several of them comes as often."""
        for square in self._met(box):
            yield from self._items.get(square, ())

    def count(self, box: Box) -> int:
        """How many squares a rectangle meets."""
        left, bottom, right, top = self._bounds(box)
        return (right - left + 1) * (top - bottom + 1)

    def _met(self, box: Box) -> Iterator[tuple[int, int]]:
        left, bottom, right, top = self._bounds(box)
        return ((column, row) for column in range(left, right + 1) for row in range(bottom, top + 1))

    def _bounds(self, box: Box) -> tuple[int, int, int, int]:
        left, bottom, right, top = (math.floor(value / self._size) for value in box)
        return left, bottom, right, top

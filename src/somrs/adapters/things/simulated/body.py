"""What a lift or a door is made of, as its controller sees it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

DOOR_TIME = 2.0
"""Seconds in which the doors open or close."""
SPEED = 1.0
"""Of a cabin, m/s."""


class PassageBody(Protocol):
    """A cabin with doors, or a door, which has no levels."""

    level: str | None
    """At which the cabin stands; None while it moves, and for a door."""
    doors_open: float
    """How far the doors are open: from 0, closed, to 1."""

    def move_doors(self, *, opening: bool) -> None:
        """Open or close the doors."""

    def move_to(self, level: str) -> None:
        """Take the cabin to a level. The doors are closed."""

    def step(self, seconds: float) -> None:
        """Let time pass."""


class KinematicPassage:
    """A passage whose parts move at constant speeds. `levels`: the heights of the levels by name, m; empty for a door."""

    def __init__(self, levels: Mapping[str, float]) -> None:
        self._levels = dict(levels)
        self.level: str | None = next(iter(levels), None)
        self.doors_open = 0.0
        self._height = next(iter(levels.values()), 0.0)
        self._direction = 0.0
        self._target: str | None = None

    def move_doors(self, *, opening: bool) -> None:
        self._direction = 1.0 if opening else -1.0

    def move_to(self, level: str) -> None:
        if level in self._levels and level != self.level:
            self._target, self.level = level, None

    def step(self, seconds: float) -> None:
        self.doors_open = min(max(self.doors_open + self._direction * seconds / DOOR_TIME, 0.0), 1.0)
        if self._target is not None:
            distance = self._levels[self._target] - self._height
            self._height += max(-SPEED * seconds, min(SPEED * seconds, distance))
            if self._height == self._levels[self._target]:
                self.level, self._target = self._target, None

"""What a lift or a door is made of, as its controller sees it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from somrs.adapters.things.session_messages import Doors

DOOR_TIME = 2.0
"""Seconds in which the doors open or close."""
SPEED = 1.0
"""Of a cabin, m/s."""


class PassageBody(Protocol):
    """A cabin with doors, or a door, which has no levels."""

    @property
    def level(self) -> str | None:
        """At which the cabin stands; None while it moves, and for a door."""

    @property
    def doors(self) -> Doors:
        """How the doors are."""

    @property
    def works(self) -> bool:
        """Whether it has no fault."""

    def serve(self, level: str | None) -> None:
        """Take the cabin to a level, and open the doors there. A door has no level."""

    def release(self) -> None:
        """Let the doors shut."""

    def step(self, seconds: float) -> None:
        """Let time pass."""


class KinematicPassage:
    """A passage whose parts move at constant speeds. `levels`: the heights of the levels by name, m; empty for a door."""

    works = True

    def __init__(self, levels: Mapping[str, float]) -> None:
        self._levels = dict(levels)
        self._height = next(iter(levels.values()), 0.0)
        self._target = self._height
        self._openness = 0.0
        self._is_served = False

    @property
    def level(self) -> str | None:
        return next((level for level, height in self._levels.items() if height == self._height), None)

    @property
    def doors(self) -> Doors:
        return "open" if self._openness == 1.0 else "closed" if self._openness == 0.0 else "moving"

    def serve(self, level: str | None) -> None:
        self._is_served = level is None or level in self._levels
        if level is not None and level in self._levels:
            self._target = self._levels[level]

    def release(self) -> None:
        self._is_served, self._target = False, self._target if self.level is None else self._height

    def step(self, seconds: float) -> None:
        is_there = self._height == self._target
        direction = 1.0 if self._is_served and is_there else -1.0
        if not is_there and self._openness == 0.0:
            self._height += max(-SPEED * seconds, min(SPEED * seconds, self._target - self._height))
        self._openness = min(max(self._openness + direction * seconds / DOOR_TIME, 0.0), 1.0)

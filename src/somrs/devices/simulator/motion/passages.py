"""Lifts and automatic doors, as robots use them."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from somrs.space.solids import Solid


class Lift(Protocol):
    """A lift, as robots use it."""

    @property
    def is_usable(self) -> bool:
        """Whether robots may enter it: it works, and is not out of order."""

    @property
    def hindrance(self) -> str | None:
        """Why it moves nobody now; None if it does."""

    def call(self, level: float) -> None:
        """A robot has the lift, and needs the cabin at a floor, with open doors."""

    def release(self) -> None:
        """No robot needs the lift any more."""

    def is_open(self, level: float) -> bool:
        """Whether the robot that has it can enter or leave it at a floor now."""


@runtime_checkable
class AutomaticDoor(Protocol):
    """A door that opens for robots, as they use it."""

    @property
    def solid(self) -> Solid:
        """The doorway."""

    @property
    def is_usable(self) -> bool:
        """Whether robots may drive through it: it works, and is not out of order."""

    @property
    def is_open(self) -> bool:
        """Whether robots can drive through it now."""

    @property
    def hindrance(self) -> str | None:
        """Why it does not open now; None if it does."""

    def need(self, needed: bool) -> None:
        """Whether a robot is to drive through it, or is in it."""

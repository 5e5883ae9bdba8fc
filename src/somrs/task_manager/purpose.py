"""What a transaction makes formulas true for."""

from __future__ import annotations

from enum import StrEnum


class Purpose(StrEnum):
    """What a formula is pursued for."""

    WISH = "wish"
    HANDLER = "handler"
    """A procedure that was laid down for a failure."""
    LOOK = "look"
    """Nobody knows what a failure left; a cognitive service is to find out."""
    UNDO = "undo"
    """What was done is undone by other services than the one that did it."""

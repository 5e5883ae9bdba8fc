"""Why the Task Manager pursues a goal."""

from __future__ import annotations

from enum import StrEnum


class GoalKind(StrEnum):
    """Why a formula is to be made true."""

    TASK = "task"
    """It is the client's goal."""
    HANDLER = "handler"
    """It is the goal of a handler for a failure."""
    LOOK = "look"
    """The outcome of a failure is unknown; a cognitive service observes it."""
    UNDO = "undo"
    """Services other than the original one undo what was done."""

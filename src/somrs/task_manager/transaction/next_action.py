"""What comes next in a task, as far as the pursuit of one of its goals (`goal_executor.py`) cannot settle it by itself."""

from __future__ import annotations

from msgspec import Struct


class Proceed(Struct, frozen=True):
    """Whatever comes next in the transaction may be done."""


class GoalReached(Struct, frozen=True):
    """What was pursued is so."""


class GoalUnreachable(Struct, frozen=True):
    """What was pursued cannot be had."""

    reasons: tuple[str, ...]


class NoPlanFound(Struct, frozen=True):
    """There is no plan. What failures left may be in the way; otherwise go on with `without_plan`."""

    reasons: tuple[str, ...]


class StepLost(Struct, frozen=True):
    """A step that was begun is nobody's now. A procedure may have been laid down for that; otherwise go on with `recover`."""

    step: str
    reasons: tuple[str, ...]


NextAction = Proceed | GoalReached | GoalUnreachable | NoPlanFound | StepLost

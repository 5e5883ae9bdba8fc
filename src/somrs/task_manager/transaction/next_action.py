"""The actions that the execution of a goal (`goal_executor.py`) leaves to the transaction."""

from __future__ import annotations

from msgspec import Struct

from somrs.protocol.messages.events import UndoingCheaper


class Proceed(Struct, frozen=True):
    """Continue the transaction."""


class GoalReached(Struct, frozen=True):
    """The goal holds."""


class GoalUnreachable(Struct, frozen=True):
    """The goal cannot be reached."""

    reasons: tuple[str, ...]


class NoPlanFound(Struct, frozen=True):
    """There is no plan. The transaction may compensate interrupted work first; otherwise it continues with `without_plan`."""

    reasons: tuple[str, ...]


class UndoFirst(Struct, frozen=True):
    """To undo interrupted work costs less than to go on from what it left. If nothing can be undone, the transaction continues with
    `go_on`."""

    estimate: UndoingCheaper


class StepLost(Struct, frozen=True):
    """A step lost its service after its start. The transaction may use a handler first; otherwise it continues with `recover`."""

    step: str
    reasons: tuple[str, ...]


NextAction = Proceed | GoalReached | GoalUnreachable | NoPlanFound | UndoFirst | StepLost

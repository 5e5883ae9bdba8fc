"""The recovery ladder: what to try when a step has lost its service, the cheapest first (FRP, "Recovery").

Handlers come before the steps in this module. If they lead to no plan, the transaction compensates interrupted work (`compensation.py`).
Its last step is to give up and to compensate all work.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

from msgspec import Struct, field

from somrs.protocol.messages.directory import Offer

MOST_REPLANS = 8
"""Maximum number of times that a goal is replanned without a completed step in between."""


class Replans(Struct):
    """Counts and limits how often one goal is replanned.

    `fruitless` counts since the last completed step. `total` has a limit, too, because others may undo each completed step. Its limit
    includes the steps of the longest plan, because services may fail at each of them.
    """

    fruitless: int = 0
    total: int = field(default=0, name="all")
    steps: int = 0
    fruitful: int = 0
    """The total when a step was last completed."""

    def planned(self, steps: int) -> None:
        """Record the number of steps of a plan."""
        self.steps = max(self.steps, steps)

    def count(self) -> None:
        """Count a replanning."""
        self.fruitless += 1
        self.total += 1

    def step_completed(self) -> None:
        """A step was completed."""
        self.fruitless, self.fruitful = 0, self.total

    def wait(self) -> None:
        """The goal waits to be tried again. The plans since the last completed step came to nothing for reasons that pass."""
        self.fruitless, self.total = 0, self.fruitful

    @property
    def is_exhausted(self) -> bool:
        return self.fruitless >= MOST_REPLANS or self.total >= MOST_REPLANS + self.steps

    def __str__(self) -> str:
        if self.fruitless >= MOST_REPLANS:
            return f"replanned {self.fruitless} times without a completed step"
        return f"replanned {self.total} times"


class RecoveryStep(StrEnum):
    """How to recover a step that has lost its service."""

    REPLACE = "replace"
    """Arrange the same step again, with the reported situation as its precondition."""
    REPLAN = "replan"
    """Plan from the current map to the goal, without the services that are known to be broken."""


def next_recovery_step(alternatives: Sequence[Offer], possible: bool, outcome_known: bool) -> RecoveryStep:
    """The cheapest recovery that can help.

    `alternatives` could do the step. `possible`: its precondition holds on the current map. `outcome_known`: the situation that the failure
    left is known; otherwise the step must not simply start again.
    """
    return RecoveryStep.REPLACE if alternatives and possible and outcome_known else RecoveryStep.REPLAN

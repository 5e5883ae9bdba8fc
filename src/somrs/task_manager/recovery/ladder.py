"""The ladder of recovery, cheapest rung first: what to try when a step has lost its service (FRP, "Recovery").

What a handler was laid down for goes before the ladder; undoing what failures left (`compensation.py`) comes after its second rung,
when there is no plan; giving up, with everything undone, is the transaction's last."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

from msgspec import Struct, field

from somrs.protocol.messages.directory import Offer

MOST_REPLANS = 8
"""How often one task is planned anew, with nothing completed between, before it is given up."""


class Replans(Struct):
    """How often one thing was planned anew. Nothing may be done between too few times in a row; and however much is done, not for ever:
    somebody else may undo it each time. As often as there are steps in a plan, services may fail at them."""

    fruitless: int = 0
    total: int = field(default=0, name="all")
    steps: int = 0

    def planned(self, steps: int) -> None:
        """A plan has so many steps."""
        self.steps = max(self.steps, steps)

    def count(self) -> None:
        """It is planned anew."""
        self.fruitless += 1
        self.total += 1

    def step_completed(self) -> None:
        """A step was completed."""
        self.fruitless = 0

    @property
    def is_exhausted(self) -> bool:
        return self.fruitless >= MOST_REPLANS or self.total >= MOST_REPLANS + self.steps

    def __str__(self) -> str:
        if self.fruitless >= MOST_REPLANS:
            return f"planned anew {self.fruitless} times already, and nothing was done"
        return f"planned anew {self.total} times already"


class Rung(StrEnum):
    """What to do about a step that nobody does now."""

    REPLACE = "replace"
    """Arrange the same step anew, with the reported situation as its precondition."""
    REPLAN = "replan"
    """From the map as it is now to the task's effect, without the services that are known to be broken."""


def next_rung(alternatives: Sequence[Offer], possible: bool, outcome_known: bool) -> Rung:
    """The cheapest rung that can help: `alternatives` could do the step, and its precondition is `possible` on the map as it is.

    `outcome_known`: what became of the step is known; one that is not is never simply begun again.
    """
    return Rung.REPLACE if alternatives and possible and outcome_known else Rung.REPLAN

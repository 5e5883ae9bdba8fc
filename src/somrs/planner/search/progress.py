"""How far a search got that was not finished."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from somrs.planner.grounding.finite import State
from somrs.planner.grounding.task import Task


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """`together` is how many of the goal's `parts` held in the state where most of them did."""

    states: int
    together: int
    parts: int

    def __str__(self) -> str:
        return f"{self.states} states were looked at; at best {self.together} of the goal's {self.parts} parts held at once"


def how_far(task: Task, states: Collection[State]) -> Progress:
    """What the states that were looked at come to, for the alternative of the goal that they came closest to."""
    best = Progress(states=len(states), together=0, parts=1)
    for move in task.moves:
        if move.action.operator.service is None:
            together = max(sum(state[variable] == value for variable, value in move.needs) for state in states)
            if together * best.parts >= best.together * len(move.needs):
                best = Progress(states=len(states), together=together, parts=len(move.needs))
    return best

"""The progress of an unfinished search."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from somrs.planner.grounding.finite_task import State
from somrs.planner.grounding.task import Task


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """The number of visited states, and how many of the goal's `parts` held in the best of them (`held_count`)."""

    states: int
    held_count: int
    parts: int

    def __str__(self) -> str:
        return f"{self.states} states were looked at; at best {self.held_count} of the goal's {self.parts} parts held at once"


def measure_progress(task: Task, states: Collection[State]) -> Progress:
    """The progress of the visited states, for the alternative of the goal that they came closest to."""
    best = Progress(states=len(states), held_count=0, parts=1)
    for move in task.moves:
        if move.action.operator.reaches_goal:
            held_count = max(sum(state[variable] == value for variable, value in move.preconditions) for state in states)
            if held_count * best.parts >= best.held_count * len(move.preconditions):
                best = Progress(states=len(states), held_count=held_count, parts=len(move.preconditions))
    return best

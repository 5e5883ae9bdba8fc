"""The smallest that an engine needs to know of a task: variables with a few values each, and what changes them."""

from __future__ import annotations

from dataclasses import dataclass

State = tuple[int, ...]
"""The value of each variable."""
Assignment = tuple[int, int]
"""A variable and its value."""
Effect = tuple[tuple[Assignment, ...], int, int]
"""Under these conditions (mostly none) this variable gets this value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Operation:
    """A move, by its place among the task's. `device` is the number of the one that has to do it; 0: any will do."""

    move: int
    cost: int
    needs: tuple[Assignment, ...]
    effects: tuple[Effect, ...]
    device: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class FiniteTask:
    """`names[v][x]` says what it means that variable v has the value x; `exclusive` are sets of which one holds at most."""

    names: tuple[tuple[str, ...], ...]
    initial: State
    goal: tuple[Assignment, ...]
    operations: tuple[Operation, ...]
    exclusive: tuple[tuple[Assignment, ...], ...]

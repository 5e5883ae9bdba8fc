"""The minimal finite-domain representation of a task for engines: variables with their values, and operations."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

State = tuple[int, ...]
"""The value of each variable."""
Assignment = tuple[int, int]
"""A variable and its value."""
Effect = tuple[tuple[Assignment, ...], int, int]
"""Conditions (mostly none), and the variable that gets a value if they hold."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Operation:
    """A move, given by its index in `Task.moves`. `device` is the number of the device that has to execute it; 0 means any device."""

    move: int
    cost: int
    preconditions: tuple[Assignment, ...]
    effects: tuple[Effect, ...]
    device: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class FiniteTask:
    """A finite-domain task. `names[v][x]` describes value x of variable v; at most one assignment of each of the `mutex_groups` holds."""

    names: tuple[tuple[str, ...], ...]
    initial: State
    goal: tuple[Assignment, ...]
    operations: tuple[Operation, ...]
    mutex_groups: tuple[tuple[Assignment, ...], ...]


def prune_irrelevant(task: FiniteTask) -> FiniteTask:
    """The task without variables that the goal does not depend on, and without operations that change only such variables."""
    relevant_variables = {variable for variable, _ in task.goal}
    changing: dict[int, list[Operation]] = {}
    for operation in task.operations:
        for _, variable, _ in operation.effects:
            changing.setdefault(variable, []).append(operation)
    waiting = list(relevant_variables)
    while waiting:
        for operation in changing.get(waiting.pop(), ()):
            for variable, _ in (*operation.preconditions, *(condition for conditions, *_ in operation.effects for condition in conditions)):
                if variable not in relevant_variables:
                    relevant_variables.add(variable)
                    waiting.append(variable)
    number = {old: new for new, old in enumerate(sorted(relevant_variables))}

    def renumber(assignments: Iterable[Assignment]) -> tuple[Assignment, ...]:
        return tuple((number[variable], value) for variable, value in assignments if variable in number)

    operations = (
        replace(
            operation,
            preconditions=renumber(operation.preconditions),
            effects=tuple((renumber(c), number[variable], value) for c, variable, value in operation.effects if variable in number),
        )
        for operation in task.operations
    )
    return FiniteTask(
        names=tuple(task.names[old] for old in sorted(relevant_variables)),
        initial=tuple(task.initial[old] for old in sorted(relevant_variables)),
        goal=renumber(task.goal),
        operations=tuple(operation for operation in operations if operation.effects),
        mutex_groups=tuple(group for old in task.mutex_groups if len(group := renumber(old)) > 1),
    )

"""Why there may be no plan, by counting: the state equation of a task (van den Briel et al. 2007, Bonet 2013).

However often each operation is carried out, and in whichever order: what is so in the end was so in the beginning, or was brought about
once more often than it was taken away. That is a set of linear inequalities. If no numbers of times satisfy them, there is no plan; if some
do, there may be one. Searches do not see such things: that a lift, say, counts one passenger less than it has to let out.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from somrs.planner.finite import Assignment, FiniteTask, Operation


class Term(NamedTuple):
    """By how much one more of an operation (its place) raises, at the most, how often a fact (its place) is so."""

    fact: int
    operation: int
    change: int


class Equation(NamedTuple):
    """`terms`, summed over how often each operation is carried out, have to give `least` for each fact, at the least."""

    facts: tuple[Assignment, ...]
    least: tuple[int, ...]
    operations: int
    terms: tuple[Term, ...]


def equation(task: FiniteTask) -> Equation:
    """The state equation of the task."""
    places = {(variable, value): 0 for variable, names in enumerate(task.names) for value in range(len(names))}
    for place, fact in enumerate(places):
        places[fact] = place
    goal = frozenset(task.goal)
    least = tuple((fact in goal) - (task.initial[fact[0]] == fact[1]) for fact in places)
    terms = (Term(places[fact], number, change) for number, operation in enumerate(task.operations) for fact, change in _changes(operation))
    return Equation(facts=tuple(places), least=least, operations=len(task.operations), terms=tuple(terms))


def _changes(operation: Operation) -> Iterator[tuple[Assignment, int]]:
    """By how much it raises each fact at the most. What it takes away is certain only where it says what was so before it, and changes
    that whatever else is so."""
    needs = dict(operation.needs)
    brought = {(variable, value) for _, variable, value in operation.effects}
    for variable, value in brought:
        if needs.get(variable) != value:
            yield (variable, value), 1
    taken = {variable for conditions, variable, value in operation.effects if not conditions and needs.get(variable, value) != value}
    for variable in taken:
        if (fact := (variable, needs[variable])) not in brought:
            yield fact, -1

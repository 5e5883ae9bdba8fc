"""Why there may be no plan, by counting: the state equation of a task (van den Briel et al. 2007, Bonet 2013).

However often each operation is carried out, and in whichever order: what is so in the end was so in the beginning, or was brought about
once more often than it was taken away. That is a set of linear inequalities. If no numbers of times satisfy them, there is no plan; if some
do, there may be one. Searches do not see such things: that a lift, say, counts one passenger less than it has to let out.

What an operation needs and leaves as it is does not count: data is put on a message and taken off it, wherever the message is. It does
where two variables are looked at together (Bonet and van den Briel 2014): a message at a sensor with the data becomes a message at
the base with the data only if the sensor sends it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import product
from typing import NamedTuple

from somrs.planner.grounding.finite_task import Assignment, FiniteTask, Operation

Pair = tuple[int, int]
"""Two variables."""


class Case(NamedTuple):
    """An operation (its place) that is carried out when this is so."""

    operation: int
    conditions: tuple[Assignment, ...] = ()


class Term(NamedTuple):
    """By how much one more of a case (its place) raises a sum (its place), at the most."""

    sum: int
    case: int
    change: int


class Equation(NamedTuple):
    """`terms`, summed over how often each case occurs, have to give `least` for each sum, at the least. The first of the cases are
    the operations, whenever they are carried out."""

    cases: tuple[Case, ...]
    least: tuple[int, ...]
    terms: tuple[Term, ...]


def equation(task: FiniteTask, pairs: Iterable[Pair] = ()) -> Equation:
    """The state equation of the task: of all its variables, and of these pairs of definite ones."""
    builder = _EquationBuilder(task)
    for pair in pairs:
        builder.join(pair)
    return Equation(cases=tuple(builder.cases), least=tuple(builder.least), terms=tuple(builder.terms))


def definite(task: FiniteTask) -> set[int]:
    """The variables of which every operation says what becomes of them, whatever else is so."""
    vague: set[int] = set()
    for operation in task.operations:
        changed = [variable for _, variable, _ in operation.effects]
        vague.update(variable for conditions, variable, _ in operation.effects if conditions or changed.count(variable) > 1)
    return set(range(len(task.names))) - vague


def companions(task: FiniteTask) -> list[Pair]:
    """The pairs that are worth being looked at together: whatever changes the one says what the other is, as data is put on a message, and
    taken off it, only where the message is. More pairs would show more, in much more time."""
    changing = _changing(task)
    clear = definite(task) & changing.keys()
    pairs: set[Pair] = set()
    for variable in clear:
        condition_variables = [
            {condition_variable for condition_variable, _ in task.operations[number].preconditions} for number in changing[variable]
        ]
        pairs.update(
            (min(variable, companion), max(variable, companion)) for companion in clear.intersection(*condition_variables) - {variable}
        )
    return sorted(pairs)


class _EquationBuilder:
    """An equation that grows."""

    def __init__(self, task: FiniteTask) -> None:
        self.task = task
        self.goal = frozenset(task.goal)
        self.changing = _changing(task)
        self.cases = [Case(number) for number in range(len(task.operations))]
        self.least: list[int] = []
        self.terms: list[Term] = []
        sums = {(variable, value): self._sum((variable, value)) for variable, names in enumerate(task.names) for value in range(len(names))}
        for number, operation in enumerate(task.operations):
            self.terms += (Term(sums[fact], number, change) for fact, change in _changes(operation))

    def join(self, pair: Pair) -> None:
        """Count how often the two variables have which values. What changes one of them changes that."""
        domains = [range(len(self.task.names[variable])) for variable in pair]
        sums = {values: self._sum(*zip(pair, values, strict=True)) for values in product(*domains)}
        for number in sorted({number for variable in pair for number in self.changing.get(variable, ())}):
            operation = self.task.operations[number]
            preconditions = dict(operation.preconditions)
            new_values = {variable: value for _, variable, value in operation.effects}
            values_before = list(
                product(*([preconditions[v]] if v in preconditions else values for v, values in zip(pair, domains, strict=True)))
            )
            for values, case in zip(values_before, self._split(number, pair, values_before), strict=True):
                values_after = (new_values.get(pair[0], values[0]), new_values.get(pair[1], values[1]))
                if values_after != values:
                    self.terms += (Term(sums[values], case, -1), Term(sums[values_after], case, 1))

    def _sum(self, *facts: Assignment) -> int:
        """How often the facts begin to be so together, less how often they cease to."""
        at_first = all(self.task.initial[variable] == value for variable, value in facts)
        self.least.append(self.goal.issuperset(facts) - at_first)
        return len(self.least) - 1

    def _split(self, number: int, pair: Pair, values_before: list[tuple[int, ...]]) -> list[int]:
        """The cases of an operation by what the pair is before it: they occur as often as the operation is carried out."""
        if len(values_before) == 1:
            return [number]
        cases = list(range(len(self.cases), len(self.cases) + len(values_before)))
        self.cases += (Case(number, tuple(zip(pair, values, strict=True))) for values in values_before)
        for sign in (1, -1):
            self.terms += (Term(len(self.least), number, -sign), *(Term(len(self.least), case, sign) for case in cases))
            self.least.append(0)
        return cases


def _changing(task: FiniteTask) -> dict[int, list[int]]:
    """For each variable, the operations that change it."""
    operations_by_variable: dict[int, list[int]] = {}
    for number, operation in enumerate(task.operations):
        for variable in {variable for _, variable, _ in operation.effects}:
            operations_by_variable.setdefault(variable, []).append(number)
    return operations_by_variable


def _changes(operation: Operation) -> Iterator[tuple[Assignment, int]]:
    """By how much it raises each fact at the most. What it takes away is certain only where it says what was so before it, and changes
    that whatever else is so."""
    preconditions = dict(operation.preconditions)
    added_facts = {(variable, value) for _, variable, value in operation.effects}
    for variable, value in added_facts:
        if preconditions.get(variable) != value:
            yield (variable, value), 1
    deleted_variables = {
        variable for conditions, variable, value in operation.effects if not conditions and preconditions.get(variable, value) != value
    }
    for variable in deleted_variables:
        if (fact := (variable, preconditions[variable])) not in added_facts:
            yield fact, -1

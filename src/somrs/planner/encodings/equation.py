"""The state equation of a task, which proves for some tasks that there is no plan (van den Briel et al. 2007, Bonet 2013).

In every plan, a fact that holds at the end holds at the start, or operations add it once more often than they delete it. This gives linear
inequalities for the number of times that each operation is executed. If the inequalities have no solution, there is no plan; if they have
one, there may be a plan. Heuristic search cannot find such proofs, for example that a lift takes in one passenger less than it has to let
out.

The equation ignores preconditions that an operation keeps: data can be put on a message and taken off it, wherever the message is. Pairs of
variables take them into account (Bonet and van den Briel 2014): a message with the data at a sensor becomes a message with the data at the
base only if the sensor sends it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import product
from typing import NamedTuple

from somrs.planner.grounding.finite_task import Assignment, FiniteTask, Operation

Pair = tuple[int, int]
"""Two variables."""


class Case(NamedTuple):
    """The execution of an operation (its index) when the conditions hold."""

    operation: int
    conditions: tuple[Assignment, ...] = ()


class Term(NamedTuple):
    """The maximum change of a sum (its index) by one occurrence of a case (its index)."""

    sum: int
    case: int
    change: int


class Equation(NamedTuple):
    """Linear inequalities: for each sum, its terms, weighted by the number of occurrences of their cases, add up to at least `least`. The
    first cases are the operations without conditions."""

    cases: tuple[Case, ...]
    least: tuple[int, ...]
    terms: tuple[Term, ...]


def equation(task: FiniteTask, pairs: Iterable[Pair] = ()) -> Equation:
    """The state equation of the task, for all variables and for the given pairs of definite variables."""
    builder = _EquationBuilder(task)
    for pair in pairs:
        builder.join(pair)
    return Equation(cases=tuple(builder.cases), least=tuple(builder.least), terms=tuple(builder.terms))


def definite(task: FiniteTask) -> set[int]:
    """The variables that no operation changes conditionally or twice."""
    vague: set[int] = set()
    for operation in task.operations:
        changed = [variable for _, variable, _ in operation.effects]
        vague.update(variable for conditions, variable, _ in operation.effects if conditions or changed.count(variable) > 1)
    return set(range(len(task.names))) - vague


def companions(task: FiniteTask) -> list[Pair]:
    """The pairs of variables that are worth joining: all operations that change the one have a precondition on the other, as data is put on
    a message, and taken off it, only where the message is. More pairs would prove more, in much more time."""
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
    """Builds an equation."""

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
        """Add the sums of all pairs of values of the two variables, and the changes by operations on either variable."""
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
        """Add a sum: how often the facts become true together, less how often they cease to be. Returns its index."""
        at_first = all(self.task.initial[variable] == value for variable, value in facts)
        self.least.append(self.goal.issuperset(facts) - at_first)
        return len(self.least) - 1

    def _split(self, number: int, pair: Pair, values_before: list[tuple[int, ...]]) -> list[int]:
        """The cases of an operation, one for each pair of values before it; together they occur as often as the operation."""
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
    """The maximum change of each fact by the operation. It deletes a fact for certain only if the fact is a precondition and the effect is
    unconditional."""
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

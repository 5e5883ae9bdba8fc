"""A task as clauses that are satisfiable if there is a plan of a given number of parallel steps (Kautz and Selman 1992).

This encoding is strong where every plan consumes scarce resources, such as energy: there heuristic search runs into dead ends that its
heuristics do not detect, while a SAT solver propagates constraints between steps. The operations of one step need their preconditions at
the start of the step, and can be executed one by one in the order of the operations (Rintanen, Heljanko and Niemelä 2006).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from itertools import combinations
from math import ceil, sqrt

from somrs.planner.grounding.finite_task import Assignment, FiniteTask, Operation

PAIRWISE_LIMIT = 5
"""Up to this number of literals, at-most-one constraints are pairwise; beyond it, they use rows and columns."""


class Clauses:
    """Builds the clauses step by step. Literals are numbers from 1, negative if negated, as in DIMACS. With `busy`, each device performs at
    most one operation in a step, so the number of steps is the makespan."""

    def __init__(self, task: FiniteTask, add: Callable[[list[int]], None], *, busy: bool = False) -> None:
        self.task, self.busy = task, busy
        self.literals = 0
        self._add = add
        self._operations: list[tuple[int, Operation]] = []
        """The reachable operations, each with the first step in which it is applicable."""
        self._level = self._levels()
        self._held: list[dict[Assignment, int]] = []
        self._literals_by_step: list[list[tuple[Operation, int]]] = []
        self._begin()

    @property
    def steps(self) -> int:
        return len(self._literals_by_step)

    @property
    def least(self) -> int | None:
        """A lower bound of the number of steps; None if there is no plan."""
        return max((self._level[part] for part in self.task.goal), default=0) if all(p in self._level for p in self.task.goal) else None

    def extend(self) -> None:
        """Add the clauses of one more step."""
        facts_before = self._held[-1]
        step = self.steps
        step_literals = [(operation, self._new_literal()) for level, operation in self._operations if level <= step]
        facts_after = self._layer(step + 1)
        self._literals_by_step.append(step_literals)
        makers: dict[Assignment, list[int]] = {}
        for operation, literal in step_literals:
            for precondition in operation.preconditions:
                self._add([-literal, facts_before[precondition]])
            for conditions, variable, value in operation.effects:
                maker = (
                    self._add_conjunction(literal, [facts_before[c] for c in conditions if c in facts_before]) if conditions else literal
                )
                if all(condition in facts_before for condition in conditions):
                    self._add([-maker, facts_after[variable, value]])
                    makers.setdefault((variable, value), []).append(maker)
        for fact, literal in facts_after.items():
            self._add([-literal, *([facts_before[fact]] if fact in facts_before else []), *makers.get(fact, [])])
        self._in_order(step_literals)
        self._exclude_conditional(step_literals)
        if self.busy:
            self._serialize_devices(step_literals)

    def goal_assumptions(self, steps: int) -> list[int]:
        """The literals to assume so that the goal holds after `steps` steps."""
        return [self._held[steps][part] for part in self.task.goal]

    def plan(self, true: Collection[int], steps: int) -> list[int]:
        """The moves of a model with the given true literals, in order of execution."""
        return [
            operation.move for step_literals in self._literals_by_step[:steps] for operation, literal in step_literals if literal in true
        ]

    def _levels(self) -> dict[Assignment, int]:
        level = dict.fromkeys(enumerate(self.task.initial), 0)
        waiting = operations = _ordered(self.task)
        first: dict[int, int] = {}
        step = 0
        while True:
            ready = [operation for operation in waiting if all(precondition in level for precondition in operation.preconditions)]
            if not ready:
                break
            waiting = [operation for operation in waiting if not all(precondition in level for precondition in operation.preconditions)]
            for operation in ready:
                first[operation.move] = step
                for _, variable, value in operation.effects:
                    level.setdefault((variable, value), step + 1)
            step += 1
        self._operations = [(first[operation.move], operation) for operation in operations if operation.move in first]
        return level

    def _begin(self) -> None:
        first = self._layer(0)
        for fact in enumerate(self.task.initial):
            self._add([first[fact]])

    def _layer(self, step: int) -> dict[Assignment, int]:
        held = {fact: self._new_literal() for fact, level in self._level.items() if level <= step}
        literals_by_variable: dict[int, list[int]] = {}
        for (variable, _), literal in held.items():
            literals_by_variable.setdefault(variable, []).append(literal)
        for literals in literals_by_variable.values():
            self._add(literals)
            self._add_at_most_one(literals)
        for group in self.task.mutex_groups:
            self._add_at_most_one([held[fact] for fact in group if fact in held])
        self._held.append(held)
        return held

    def _in_order(self, step_literals: list[tuple[Operation, int]]) -> None:
        """Add clauses so that no operation of a step deletes a fact that a later operation of the step needs."""
        concerned: dict[Assignment, list[tuple[int, bool, bool]]] = {}
        for operation, literal in step_literals:
            new_values = {variable: value for _, variable, value in operation.effects}
            preconditions = dict(operation.preconditions)
            for variable, value in preconditions.items():
                concerned.setdefault((variable, value), []).append((literal, True, new_values.get(variable, value) != value))
            for variable, value in new_values.items():
                if variable not in preconditions:
                    for other_value in range(len(self.task.names[variable])):
                        if other_value != value:
                            concerned.setdefault((variable, other_value), []).append((literal, False, True))
        for literals in concerned.values():
            deletion: int | None = None
            for literal, requires_fact, deletes_fact in literals:
                if deletion is not None and requires_fact:
                    self._add([-deletion, -literal])
                if deletes_fact:
                    previous, deletion = deletion, self._new_literal()
                    self._add([-literal, deletion])
                    if previous is not None:
                        self._add([-previous, deletion])

    def _serialize_devices(self, step_literals: list[tuple[Operation, int]]) -> None:
        literals_by_device: dict[int, list[int]] = {}
        for operation, literal in step_literals:
            if operation.device:
                literals_by_device.setdefault(operation.device, []).append(literal)
        for literals in literals_by_device.values():
            self._add_at_most_one(literals)

    def _exclude_conditional(self, step_literals: list[tuple[Operation, int]]) -> None:
        """Add clauses so that an operation with conditional effects is the only one of its step: its effects depend on other operations."""
        conditional_literals = [literal for operation, literal in step_literals if any(conditions for conditions, *_ in operation.effects)]
        if conditional_literals:
            any_conditional = self._new_literal()
            self._add_at_most_one(conditional_literals)
            for literal in conditional_literals:
                self._add([-literal, any_conditional])
            for literal in {literal for _, literal in step_literals} - {*conditional_literals}:
                self._add([-literal, -any_conditional])

    def _add_conjunction(self, literal: int, conditions: list[int]) -> int:
        """A new literal that is equivalent to the conjunction of the literal and the conditions."""
        conjunction = self._new_literal()
        for part in (literal, *conditions):
            self._add([-conjunction, part])
        self._add([conjunction, -literal, *(-condition for condition in conditions)])
        return conjunction

    def _add_at_most_one(self, literals: Iterable[int]) -> None:
        """Add clauses so that at most one literal holds: pairwise for few literals, else by the product encoding with rows and columns
        (Chen 2010)."""
        members = list(literals)
        if len(members) <= PAIRWISE_LIMIT:
            for first, second in combinations(members, 2):
                self._add([-first, -second])
            return
        width = ceil(sqrt(len(members)))
        rows, columns = [self._new_literal() for _ in range(ceil(len(members) / width))], [self._new_literal() for _ in range(width)]
        for place, literal in enumerate(members):
            self._add([-literal, rows[place // width]])
            self._add([-literal, columns[place % width]])
        self._add_at_most_one(rows)
        self._add_at_most_one(columns)

    def _new_literal(self) -> int:
        self.literals += 1
        return self.literals


def _ordered(task: FiniteTask) -> list[Operation]:
    """The operations in an order in which, as far as possible, those that need and keep a fact come before those that delete it, so that
    one step can have many operations. (Reverse postorder of a depth-first search from operations to those that delete what they need.)"""
    deleters: dict[Assignment, list[int]] = {}
    kept_facts: list[list[Assignment]] = []
    for number, operation in enumerate(task.operations):
        new_values = {variable: value for _, variable, value in operation.effects}
        deleted_facts = [(variable, value) for variable, value in operation.preconditions if new_values.get(variable, value) != value]
        kept_facts.append([precondition for precondition in operation.preconditions if precondition not in deleted_facts])
        for fact in deleted_facts:
            deleters.setdefault(fact, []).append(number)
    finished: list[int] = []
    seen_operations, seen_facts = set[int](), set[Assignment]()
    for start in range(len(task.operations)):
        stack = [(start, False)]
        while stack:
            number, is_finished = stack.pop()
            if is_finished:
                finished.append(number)
                continue
            if number in seen_operations:
                continue
            seen_operations.add(number)
            stack.append((number, True))
            for fact in kept_facts[number]:
                if fact not in seen_facts:
                    seen_facts.add(fact)
                    stack.extend((deleter, False) for deleter in deleters.get(fact, ()) if deleter not in seen_operations)
    return [task.operations[number] for number in reversed(finished)]

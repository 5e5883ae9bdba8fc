"""A task as clauses: is there a plan of so many steps, in each of which any number of agents act? (Kautz and Selman 1992)

It finds plans where every way to the goal takes scarce things (energy, say): there a search walks into dead ends that no
estimate sees, while what the clauses say of one step rules out what another one did. Actions of one step need what holds when
it begins, and can be done one after another in the order of the operations (Rintanen, Heljanko and Niemelä 2006).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from itertools import combinations
from math import ceil, sqrt

from somrs.planner.grounding.finite_task import Assignment, FiniteTask, Operation

PAIRWISE_LIMIT = 5
"""Of so many literals each pair is excluded; of more, by rows and columns."""


class Clauses:
    """The clauses for one step after another. Literals are numbers from 1, with a minus before what is not so. `busy`: each device does
    one thing in a step, so that a plan takes as long as it has steps."""

    def __init__(self, task: FiniteTask, add: Callable[[list[int]], None], *, busy: bool = False) -> None:
        self.task, self.busy = task, busy
        self.literals = 0
        self._add = add
        self._operations: list[tuple[int, Operation]] = []
        """The operations that can be reached, each with the first step in which it can be done."""
        self._level = self._levels()
        self._held: list[dict[Assignment, int]] = []
        self._literals_by_step: list[list[tuple[Operation, int]]] = []
        self._begin()

    @property
    def steps(self) -> int:
        return len(self._literals_by_step)

    @property
    def least(self) -> int | None:
        """No plan has fewer steps; None: there is no plan."""
        return max((self._level[part] for part in self.task.goal), default=0) if all(p in self._level for p in self.task.goal) else None

    def extend(self) -> None:
        """Clauses for one step more."""
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
        """What is to be assumed for the goal to hold after so many steps."""
        return [self._held[steps][part] for part in self.task.goal]

    def plan(self, true: Collection[int], steps: int) -> list[int]:
        """The moves of a solution, in order."""
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
        """Of the operations of a step none takes away what a later one needs."""
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
        """What an operation does under conditions depends on what others do; it is the only one of its step."""
        conditional_literals = [literal for operation, literal in step_literals if any(conditions for conditions, *_ in operation.effects)]
        if conditional_literals:
            any_conditional = self._new_literal()
            self._add_at_most_one(conditional_literals)
            for literal in conditional_literals:
                self._add([-literal, any_conditional])
            for literal in {literal for _, literal in step_literals} - {*conditional_literals}:
                self._add([-literal, -any_conditional])

    def _add_conjunction(self, literal: int, conditions: list[int]) -> int:
        """The literal for: this one, and the conditions."""
        conjunction = self._new_literal()
        for part in (literal, *conditions):
            self._add([-conjunction, part])
        self._add([conjunction, -literal, *(-condition for condition in conditions)])
        return conjunction

    def _add_at_most_one(self, literals: Iterable[int]) -> None:
        """By rows and columns, of each of which at most one holds (Chen 2010)."""
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
    """The operations so that, as far as can be, what leaves a fact as it is comes before what takes it away: so most can be done
    in one step. (Depth first, from operations to those that take away what they need; the last one finished comes first.)"""
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

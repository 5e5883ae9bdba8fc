"""A task as clauses: is there a plan of so many steps, in each of which any number of agents act? (Kautz and Selman 1992)

It finds plans where every way to the goal takes scarce things (energy, say): there a search walks into dead ends that no
estimate sees, while what the clauses say of one step rules out what another one did. Actions of one step need what holds when
it begins, and can be done one after another in the order of the operations (Rintanen, Heljanko and Niemelä 2006).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from itertools import combinations
from math import ceil, sqrt

from somrs.planner.grounding.finite import Assignment, FiniteTask, Operation

FEW = 5
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
        self._done: list[list[tuple[Operation, int]]] = []
        self._begin()

    @property
    def steps(self) -> int:
        return len(self._done)

    @property
    def least(self) -> int | None:
        """No plan has fewer steps; None: there is no plan."""
        return max((self._level[part] for part in self.task.goal), default=0) if all(p in self._level for p in self.task.goal) else None

    def extend(self) -> None:
        """Clauses for one step more."""
        before = self._held[-1]
        step = self.steps
        done = [(operation, self._new()) for level, operation in self._operations if level <= step]
        after = self._layer(step + 1)
        self._done.append(done)
        makers: dict[Assignment, list[int]] = {}
        for operation, literal in done:
            for need in operation.needs:
                self._add([-literal, before[need]])
            for conditions, variable, value in operation.effects:
                maker = self._under(literal, [before[c] for c in conditions if c in before]) if conditions else literal
                if all(condition in before for condition in conditions):
                    self._add([-maker, after[variable, value]])
                    makers.setdefault((variable, value), []).append(maker)
        for fact, literal in after.items():
            self._add([-literal, *([before[fact]] if fact in before else []), *makers.get(fact, [])])
        self._in_order(done)
        self._alone(done)
        if self.busy:
            self._one_at_a_time(done)

    def reached(self, steps: int) -> list[int]:
        """What is to be assumed for the goal to hold after so many steps."""
        return [self._held[steps][part] for part in self.task.goal]

    def plan(self, true: Collection[int], steps: int) -> list[int]:
        """The moves of a solution, in order."""
        return [operation.move for done in self._done[:steps] for operation, literal in done if literal in true]

    def _levels(self) -> dict[Assignment, int]:
        level = dict.fromkeys(enumerate(self.task.initial), 0)
        waiting = every = _ordered(self.task)
        first: dict[int, int] = {}
        step = 0
        while True:
            ready = [operation for operation in waiting if all(need in level for need in operation.needs)]
            if not ready:
                break
            waiting = [operation for operation in waiting if not all(need in level for need in operation.needs)]
            for operation in ready:
                first[operation.move] = step
                for _, variable, value in operation.effects:
                    level.setdefault((variable, value), step + 1)
            step += 1
        self._operations = [(first[operation.move], operation) for operation in every if operation.move in first]
        return level

    def _begin(self) -> None:
        first = self._layer(0)
        for fact in enumerate(self.task.initial):
            self._add([first[fact]])

    def _layer(self, step: int) -> dict[Assignment, int]:
        held = {fact: self._new() for fact, level in self._level.items() if level <= step}
        of: dict[int, list[int]] = {}
        for (variable, _), literal in held.items():
            of.setdefault(variable, []).append(literal)
        for literals in of.values():
            self._add(literals)
            self._at_most_one(literals)
        for group in self.task.exclusive:
            self._at_most_one([held[fact] for fact in group if fact in held])
        self._held.append(held)
        return held

    def _in_order(self, done: list[tuple[Operation, int]]) -> None:
        """Of the operations of a step none takes away what a later one needs."""
        concerned: dict[Assignment, list[tuple[int, bool, bool]]] = {}
        for operation, literal in done:
            made = {variable: value for _, variable, value in operation.effects}
            needs = dict(operation.needs)
            for variable, value in needs.items():
                concerned.setdefault((variable, value), []).append((literal, True, made.get(variable, value) != value))
            for variable, value in made.items():
                if variable not in needs:
                    for other in range(len(self.task.names[variable])):
                        if other != value:
                            concerned.setdefault((variable, other), []).append((literal, False, True))
        for literals in concerned.values():
            gone: int | None = None
            for literal, needs_it, takes_it in literals:
                if gone is not None and needs_it:
                    self._add([-gone, -literal])
                if takes_it:
                    before, gone = gone, self._new()
                    self._add([-literal, gone])
                    if before is not None:
                        self._add([-before, gone])

    def _one_at_a_time(self, done: list[tuple[Operation, int]]) -> None:
        of: dict[int, list[int]] = {}
        for operation, literal in done:
            if operation.device:
                of.setdefault(operation.device, []).append(literal)
        for literals in of.values():
            self._at_most_one(literals)

    def _alone(self, done: list[tuple[Operation, int]]) -> None:
        """What an operation does under conditions depends on what others do; it is the only one of its step."""
        lonely = [literal for operation, literal in done if any(conditions for conditions, *_ in operation.effects)]
        if lonely:
            one = self._new()
            self._at_most_one(lonely)
            for literal in lonely:
                self._add([-literal, one])
            for literal in {literal for _, literal in done} - {*lonely}:
                self._add([-literal, -one])

    def _under(self, literal: int, conditions: list[int]) -> int:
        """The literal for: this one, and the conditions."""
        both = self._new()
        for part in (literal, *conditions):
            self._add([-both, part])
        self._add([both, -literal, *(-condition for condition in conditions)])
        return both

    def _at_most_one(self, literals: Iterable[int]) -> None:
        """By rows and columns, of each of which at most one holds (Chen 2010)."""
        every = list(literals)
        if len(every) <= FEW:
            for one, other in combinations(every, 2):
                self._add([-one, -other])
            return
        width = ceil(sqrt(len(every)))
        rows, columns = [self._new() for _ in range(ceil(len(every) / width))], [self._new() for _ in range(width)]
        for place, literal in enumerate(every):
            self._add([-literal, rows[place // width]])
            self._add([-literal, columns[place % width]])
        self._at_most_one(rows)
        self._at_most_one(columns)

    def _new(self) -> int:
        self.literals += 1
        return self.literals


def _ordered(task: FiniteTask) -> list[Operation]:
    """The operations so that, as far as can be, what leaves a fact as it is comes before what takes it away: so most can be done
    in one step. (Depth first, from operations to those that take away what they need; the last one finished comes first.)"""
    takers: dict[Assignment, list[int]] = {}
    keeps: list[list[Assignment]] = []
    for number, operation in enumerate(task.operations):
        made = {variable: value for _, variable, value in operation.effects}
        taken = [(variable, value) for variable, value in operation.needs if made.get(variable, value) != value]
        keeps.append([need for need in operation.needs if need not in taken])
        for need in taken:
            takers.setdefault(need, []).append(number)
    finished: list[int] = []
    seen_operations, seen_facts = set[int](), set[Assignment]()
    for start in range(len(task.operations)):
        stack = [(start, False)]
        while stack:
            number, over = stack.pop()
            if over:
                finished.append(number)
                continue
            if number in seen_operations:
                continue
            seen_operations.add(number)
            stack.append((number, True))
            for need in keeps[number]:
                if need not in seen_facts:
                    seen_facts.add(need)
                    stack.extend((other, False) for other in takers.get(need, ()) if other not in seen_operations)
    return [task.operations[number] for number in reversed(finished)]

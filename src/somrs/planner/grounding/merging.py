"""The task for engines, with as few variables and preconditions as possible.

The facts of a mutex group (`invariants.py`) become the values of one variable. Preconditions that other preconditions imply are dropped,
and then variables that the goal does not depend on.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from heapq import heapify, heappop, heappush

from somrs.planner.grounding.finite_task import Assignment, FiniteTask, Operation, prune_irrelevant
from somrs.planner.grounding.invariants import find_mutex_groups
from somrs.planner.grounding.task import Task
from somrs.planner.model.vocabulary import Fact

DEAREST = 10_000
"""The cost of the most expensive move after scaling to integers."""


def merge_task(task: Task) -> FiniteTask:
    """The task with mutually exclusive facts merged into one variable."""
    mutex_groups = find_mutex_groups(task)
    costs = _integer_costs([move.cost for move in task.moves])
    devices: dict[str | None, int] = {None: 0}
    operations = [
        Operation(
            move=number,
            cost=costs[number],
            preconditions=move.preconditions,
            effects=move.effects,
            device=devices.setdefault(move.action.provider, len(devices)),
        )
        for number, move in enumerate(task.moves)
    ]
    excludes = _excludes(task, mutex_groups)
    operations = _drop_static_preconditions(_reachable_operations(task, operations, excludes))
    operations = _drop_implied_preconditions(task, operations, mutex_groups, excludes)
    return prune_irrelevant(_Merging(task, mutex_groups, operations).task())


def _integer_costs(costs: list[float]) -> list[int]:
    """The costs as integers, scaled if needed: engines accept only integers that are not very large."""
    if all(cost == int(cost) and cost <= DEAREST for cost in costs):
        return list(map(int, costs))
    return [round(cost * DEAREST / max(costs)) for cost in costs]


def _excludes(task: Task, mutex_groups: list[tuple[Fact, ...]]) -> dict[Assignment, set[Assignment]]:
    """For each assignment, those that cannot hold at the same time according to the mutex groups."""
    excludes: dict[Assignment, set[Assignment]] = {}
    for group in mutex_groups:
        places = [task.place[fact] for fact in group]
        for place in places:
            excludes.setdefault(place, set()).update(places)
    for place, rivals in excludes.items():
        rivals.discard(place)
    return excludes


def _reachable_operations(task: Task, operations: list[Operation], excludes: dict[Assignment, set[Assignment]]) -> list[Operation]:
    """The operations that are reachable in the delete relaxation and have no mutually exclusive preconditions."""
    missing_counts: list[int] = []
    needing: dict[Assignment, list[int]] = {}
    for number, operation in enumerate(operations):
        is_consistent = not any(
            excludes.get(precondition, set()).intersection(operation.preconditions) for precondition in operation.preconditions
        )
        missing_counts.append(len(operation.preconditions) if is_consistent else -1)
        for precondition in operation.preconditions if is_consistent else ():
            needing.setdefault(precondition, []).append(number)
    reached = set(enumerate(task.initial))
    waiting = list(reached)
    ready = [number for number, missing in enumerate(missing_counts) if missing == 0]
    while waiting or ready:
        if waiting:
            for number in needing.get(waiting.pop(), ()):
                missing_counts[number] -= 1
                if missing_counts[number] == 0:
                    ready.append(number)
            continue
        for _, variable, value in operations[ready.pop()].effects:
            if (variable, value) not in reached:
                reached.add((variable, value))
                waiting.append((variable, value))
    return [operation for operation, missing in zip(operations, missing_counts, strict=True) if missing == 0]


def _drop_static_preconditions(operations: list[Operation]) -> list[Operation]:
    """The operations without preconditions on variables that no operation changes."""
    changing = {variable for operation in operations for _, variable, _ in operation.effects}
    return [
        replace(o, preconditions=preconditions)
        if len(preconditions := tuple(n for n in o.preconditions if n[0] in changing)) < len(o.preconditions)
        else o
        for o in operations
    ]


def _drop_implied_preconditions(
    task: Task, operations: list[Operation], mutex_groups: list[tuple[Fact, ...]], excludes: dict[Assignment, set[Assignment]]
) -> list[Operation]:
    """The operations without implied preconditions: those whose only alternative another precondition excludes.

    Two facts of which exactly one always holds are alternatives (`is-at` and `not-at` in domains without NOT), and so are the two values
    of a binary variable.
    """
    pairs = [(task.place[group[0]], task.place[group[1]]) for group in mutex_groups if len(group) == 2]
    alternative = dict(_always_one(task, operations, pairs))
    for fact, variable in task.negated.items():
        alternative[variable, 1] = task.place[fact]
    for variable, values in enumerate(task.values):
        if len(values) == 2:
            alternative[variable, 0] = variable, 1

    def implied(precondition: Assignment, other_preconditions: Sequence[Assignment]) -> bool:
        opposite = alternative.get(precondition)
        if opposite is None:
            return False
        excluding = excludes.get(opposite, set())
        return any(
            assignment not in (precondition, opposite)
            and (assignment in excluding or (assignment[0] == opposite[0] and assignment[1] != opposite[1]))
            for assignment in other_preconditions
        )

    shortened = []
    for operation in operations:
        preconditions = list(operation.preconditions)
        for precondition in operation.preconditions:
            if implied(precondition, preconditions):
                preconditions.remove(precondition)
        shortened.append(replace(operation, preconditions=tuple(preconditions)))
    return shortened


def _always_one(
    task: Task, operations: list[Operation], pairs: list[tuple[Assignment, Assignment]]
) -> Iterator[tuple[Assignment, Assignment]]:
    """The pairs, in both orders, of which exactly one always holds: initially, and because no operation deletes one without adding the
    other."""
    partners: dict[Assignment, set[Assignment]] = {}
    for first, second in pairs:
        if (task.initial[first[0]] == first[1]) != (task.initial[second[0]] == second[1]):
            partners.setdefault(first, set()).add(second)
            partners.setdefault(second, set()).add(first)
    lost: set[tuple[Assignment, Assignment]] = set()
    """Pairs of a fact that an operation may delete and a partner that the operation does not add."""
    variables = {variable for variable, _ in partners}
    for operation in operations:
        new_assignments = {(variable, value) for conditions, variable, value in operation.effects if not conditions}
        preconditions = dict(operation.preconditions)
        for _, variable, value in operation.effects:
            if variable in variables:
                old_values = [preconditions[variable]] if variable in preconditions else range(1, len(task.values[variable]))
                lost_assignments = ((variable, old) for old in old_values if old != value)
                lost.update((first, second) for first in lost_assignments for second in partners.get(first, set()) - new_assignments)
    for first, twos in partners.items():
        for second in twos:
            if (first, second) not in lost and (second, first) not in lost:
                yield first, second


class _Merging:
    """Builds the merged task."""

    def __init__(self, task: Task, mutex_groups: list[tuple[Fact, ...]], operations: list[Operation]) -> None:
        self.old, self.operations = task, operations
        self.facts: list[list[Assignment]] = []
        """For each new variable, the old assignments that are its values; one more value, the last, means none of them."""
        self.place: dict[Assignment, Assignment] = {}
        self.mutex_groups = mutex_groups
        self._cover()

    def task(self) -> FiniteTask:
        initial = [len(values) for values in self.facts]
        for old in enumerate(self.old.initial):
            if old in self.place:
                variable, value = self.place[old]
                initial[variable] = value
        operations = [operation for old in self.operations if (operation := self._operation(old)) is not None]
        goal, operations = self._goal(operations)
        mutex_groups = [tuple(self.place[self.old.place[fact]] for fact in group) for group in self.mutex_groups]
        return FiniteTask(
            names=tuple((*(self._name(old) for old in values), "<none of those>") for values in self.facts),
            initial=tuple(initial),
            goal=goal,
            operations=tuple(operations),
            mutex_groups=tuple(group for group in mutex_groups if len({variable for variable, _ in group}) > 1),
        )

    def _goal(self, operations: list[Operation]) -> tuple[tuple[Assignment, ...], list[Operation]]:
        """The goal, and the operations without those that the goal replaces.

        If exactly one operation reaches the goal, its preconditions become the goal: heuristics of engines are better informed by a goal
        of many parts than by a single fact.
        """
        assert self.old.goal is not None, "a goal that nothing reaches is not searched for"
        reaching = [operation for operation in operations if self.old.moves[operation.move].action.operator.reaches_goal]
        if len(reaching) == 1 and reaching[0].preconditions:
            return reaching[0].preconditions, [operation for operation in operations if operation is not reaching[0]]
        return (self.place[self.old.goal],), operations

    def _name(self, old: Assignment) -> str:
        fact = self.old.values[old[0]][old[1]]
        assert fact is not None
        return f"{fact[0]}({', '.join(map(str, fact[1]))})"

    def _cover(self) -> None:
        """Cover the old variables with new ones, the largest groups first. A variable whose value 0 is a precondition or condition is not
        merged."""
        separate_variables = {variable for operation in self.operations for variable, value in operation.preconditions if value == 0}
        separate_variables |= {
            variable for operation in self.operations for conditions, *_ in operation.effects for variable, value in conditions if not value
        }
        separate_variables |= set(self.old.negated.values())
        free = {variable for variable in range(len(self.old.values)) if variable not in separate_variables}
        candidates = [(-len(group), number, [self.old.place[fact] for fact in group]) for number, group in enumerate(self.mutex_groups)]
        heapify(candidates)
        while candidates:
            size, number, group = heappop(candidates)
            whole = self._free_members(group, free)
            if len(whole) < -size and len(whole) > 1:
                heappush(candidates, (-len(whole), number, whole))
            elif len(whole) > 1:
                self._add_variable(whole)
                free -= {variable for variable, _ in whole}
        for variable, values in enumerate(self.old.values):
            if (variable, 1) not in self.place:
                self._add_variable([(variable, value) for value in range(1, len(values))])

    def _free_members(self, group: list[Assignment], free: set[int]) -> list[Assignment]:
        """The members of the group whose variable is still free and has all its facts in the group."""
        count: dict[int, int] = {}
        for variable, _ in group:
            count[variable] = count.get(variable, 0) + 1
        return [
            (variable, value) for variable, value in group if variable in free and count[variable] == len(self.old.values[variable]) - 1
        ]

    def _add_variable(self, values: Iterable[Assignment]) -> None:
        self.facts.append(list(values))
        for value, old in enumerate(self.facts[-1]):
            self.place[old] = len(self.facts) - 1, value

    def _assignment(self, old: Assignment) -> Assignment:
        if old[1] == 0:
            variable = self.place[old[0], 1][0]
            return variable, len(self.facts[variable])
        return self.place[old]

    def _operation(self, old: Operation) -> Operation | None:
        """The operation on the new variables; None if it is never applicable or changes nothing."""
        preconditions = dict.fromkeys(self._assignment(precondition) for precondition in old.preconditions)
        known_values = dict(list(preconditions))
        if len(known_values) < len(preconditions):
            return None
        new_assignments = {self.place[variable, value][0]: self.place[variable, value] for _, variable, value in old.effects if value}
        effects: dict[tuple[tuple[Assignment, ...], int], int] = {}
        for conditions, variable, value in old.effects:
            new = tuple(dict.fromkeys(self._assignment(condition) for condition in conditions))
            if any(v in known_values and known_values[v] != x for v, x in new):
                continue
            new = tuple(condition for condition in new if condition not in preconditions)
            if value:
                effects[new, self.place[variable, value][0]] = self.place[variable, value][1]
            else:
                self._lose(variable, known_values, new_assignments, new, effects)
        changing = {key: value for key, value in effects.items() if known_values.get(key[1]) != value}
        if not changing:
            return None
        return replace(old, preconditions=tuple(preconditions), effects=tuple((*key, value) for key, value in changing.items()))

    def _lose(
        self,
        old: int,
        known_values: dict[int, int],
        new_assignments: dict[int, Assignment],
        conditions: tuple[Assignment, ...],
        effects: dict[tuple[tuple[Assignment, ...], int], int],
    ) -> None:
        """Add the effects on the new variable that make all facts of an old variable false."""
        variable = self.place[old, 1][0]
        if variable in new_assignments:
            return
        none_value, mine = len(self.facts[variable]), [self.place[old, value] for value in range(1, len(self.old.values[old]))]
        if len(mine) == none_value:
            effects[conditions, variable] = none_value
            return
        condition_values = known_values | dict(conditions)
        for held in mine:
            if variable not in condition_values:
                effects[(*conditions, held), variable] = none_value
            elif condition_values[variable] == held[1]:
                effects[conditions, variable] = none_value

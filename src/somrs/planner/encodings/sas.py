"""A task in Fast Downward's translator output format, version 3, which all engines without counters read.

https://www.fast-downward.org/latest/documentation/translator-output-format/
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import takewhile
from typing import TYPE_CHECKING

from somrs.planner.grounding.finite_task import Assignment, FiniteTask, Operation

if TYPE_CHECKING:  # keeps the start of processes that only read tasks fast
    from somrs.planner.grounding.task import Move, Task


def encode_sas(task: FiniteTask) -> str:
    """The task as text. Operators are named by the index of their move and the number of their device, so no name needs escaping."""
    return "\n".join(_lines(task)) + "\n"


def decode_moves(names: list[str], task: Task) -> list[Move]:
    """The moves of an engine's plan up to the one that only reaches the goal. Moves after it may lead away from the goal."""
    moves = (task.moves[int(name.split()[0])] for name in names)
    return [*takewhile(lambda move: not move.action.operator.reaches_goal, moves)]


def _lines(task: FiniteTask) -> Iterator[str]:
    yield from ("begin_version", "3", "end_version", "begin_metric", "1", "end_metric", str(len(task.names)))
    predicates = {name: n for n, name in enumerate(dict.fromkeys(fact.partition("(")[0] for names in task.names for fact in names))}
    for variable, names in enumerate(task.names):
        yield from ("begin_variable", f"var{variable}", "-1", str(len(names)))
        for value, name in enumerate(names[:-1]):
            # Landmark heuristics group facts by their predicate.
            yield f"Atom p{predicates[name.partition('(')[0]]}(v{variable}, v{value})"
        yield from (names[-1], "end_variable")
    yield str(len(task.mutex_groups))
    for group in task.mutex_groups:
        yield from ("begin_mutex_group", *_format_assignments(group), "end_mutex_group")
    yield from ("begin_state", *map(str, task.initial), "end_state")
    yield from ("begin_goal", *_format_assignments(task.goal), "end_goal", str(len(task.operations)))
    for operation in task.operations:
        name = f"{operation.move} {operation.device}"
        yield from ("begin_operator", name, *_prevail_and_effects(operation), str(operation.cost), "end_operator")
    yield "0"


def _format_assignments(assignments: Sequence[Assignment]) -> Iterator[str]:
    yield str(len(assignments))
    yield from (f"{variable} {value}" for variable, value in assignments)


def _prevail_and_effects(operation: Operation) -> Iterator[str]:
    plain = {variable for conditions, variable, _ in operation.effects if not conditions}
    preconditions = dict(operation.preconditions)
    yield from _format_assignments([precondition for precondition in operation.preconditions if precondition[0] not in plain])
    yield str(len(operation.effects))
    for conditions, variable, value in operation.effects:
        condition_text = "".join(f"{condition_variable} {condition_value} " for condition_variable, condition_value in conditions)
        value_before = preconditions.get(variable, -1) if variable in plain else -1
        yield f"{len(conditions)} {condition_text}{variable} {value_before} {value}"


def parse_sas(text: str) -> FiniteTask:
    """The task of a text in this format."""
    lines = iter(text.splitlines())

    def numbers() -> list[int]:
        return [int(word) for word in next(lines).split()]

    def section(first: str) -> None:
        for line in lines:
            if line == first:
                return

    def assignments(count: int) -> tuple[Assignment, ...]:
        pairs = [numbers() for _ in range(count)]
        return tuple((variable, value) for variable, value in pairs)

    section("end_metric")
    names = []
    for _ in range(int(next(lines))):
        next(lines), next(lines), next(lines)
        names.append(tuple(next(lines) for _ in range(int(next(lines)))))
        next(lines)
    exclusive = []
    for _ in range(int(next(lines))):
        next(lines)
        exclusive.append(assignments(int(next(lines))))
        next(lines)
    section("begin_state")
    initial = tuple(int(next(lines)) for _ in names)
    section("begin_goal")
    goal = assignments(int(next(lines)))
    next(lines)
    operations = [_operation(lines) for _ in range(int(next(lines)))]
    return FiniteTask(names=tuple(names), initial=initial, goal=goal, operations=tuple(operations), mutex_groups=tuple(exclusive))


def _operation(lines: Iterator[str]) -> Operation:
    next(lines)
    move, device = map(int, next(lines).split())
    preconditions: list[Assignment] = []
    for _ in range(int(next(lines))):
        variable, value = map(int, next(lines).split())
        preconditions.append((variable, value))
    effects = []
    for _ in range(int(next(lines))):
        count, *rest = map(int, next(lines).split())
        conditions = tuple(zip(rest[: 2 * count : 2], rest[1 : 2 * count : 2], strict=True))
        variable, value_before, value = rest[2 * count :]
        if value_before >= 0:
            preconditions.append((variable, value_before))
        effects.append((conditions, variable, value))
    cost = int(next(lines))
    next(lines)
    return Operation(move=move, cost=cost, preconditions=tuple(preconditions), effects=tuple(effects), device=device)

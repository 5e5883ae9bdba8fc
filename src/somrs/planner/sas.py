"""A task as text for Fast Downward's search (its translator output format, version 3): an engine needs no more of us.

https://www.fast-downward.org/latest/documentation/translator-output-format/
"""

from __future__ import annotations

from collections.abc import Iterator

from somrs.planner.task import Move, Task


def written(task: Task) -> str:
    """The task. Its operators are named by their place in `task.moves`, so that no name needs escaping."""
    return "\n".join(_lines(task)) + "\n"


def read(names: list[str], task: Task) -> list[Move]:
    """The moves that an engine named, without the last one, which only says that the goal is reached."""
    moves = [task.moves[int(name.split()[0])] for name in names]
    return [move for move in moves if move.action.operator.service is not None]


def _lines(task: Task) -> Iterator[str]:
    assert task.goal is not None, "a goal that nothing reaches is not searched for"
    yield from ("begin_version", "3", "end_version", "begin_metric", "1", "end_metric", str(len(task.values)))
    predicates = {name: n for n, name in enumerate(dict.fromkeys(fact[0] for values in task.values for fact in values if fact))}
    for variable, values in enumerate(task.values):
        yield from ("begin_variable", f"var{variable}", "-1", str(len(values)))
        for value, fact in enumerate(values):
            # Landmark heuristics group facts by their predicate.
            yield f"Atom p{predicates[fact[0]]}(v{variable}, v{value})" if fact else "<none of those>"
        yield "end_variable"
    yield "0"
    yield from ("begin_state", *map(str, task.initial), "end_state")
    yield from ("begin_goal", "1", f"{task.goal[0]} {task.goal[1]}", "end_goal", str(len(task.moves)))
    for number, move in enumerate(task.moves):
        yield from ("begin_operator", str(number), *_needs_and_effects(move), str(move.cost), "end_operator")
    yield "0"


def _needs_and_effects(move: Move) -> Iterator[str]:
    plain = {variable for conditions, variable, _ in move.effects if not conditions}
    needs = dict(move.needs)
    prevail = {variable: value for variable, value in needs.items() if variable not in plain}
    yield str(len(prevail))
    yield from (f"{variable} {value}" for variable, value in prevail.items())
    yield str(len(move.effects))
    for conditions, variable, value in move.effects:
        shown = "".join(f"{other} {wanted} " for other, wanted in conditions)
        before = -1 if variable in prevail else needs.get(variable, -1)
        yield f"{len(conditions)} {shown}{variable} {before} {value}"

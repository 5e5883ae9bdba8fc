"""A process that proves by the state equation (`planner/encodings/equation.py`) that there is no plan, with SciPy's solver HiGHS.

`python -m somrs.planner_service.engine_equation TASK` exits with code 11 when there is no plan, and with 1 when there may be one.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from scipy.optimize import linprog
from scipy.sparse import csr_array

from somrs.planner.encodings.equation import Equation, companions, equation
from somrs.planner.encodings.sas import parse_sas
from somrs.planner.grounding.finite_task import FiniteTask, prune_irrelevant

UNSOLVABLE = 11
"""The exit code for an unsolvable task, the same as Fast Downward's."""
INFEASIBLE = 2
"""SciPy's status of an infeasible linear program."""


def main(task: str) -> int:
    finite_task = parse_sas(Path(task).read_text(encoding="ascii"))
    return UNSOLVABLE if any(map(is_unsatisfiable, equations(finite_task))) else 1


def equations(task: FiniteTask) -> Iterator[Equation]:
    """The equation of the task; then the equations of its parts with pairs of variables. Parts take a second where the whole task with
    pairs would take a minute."""
    yield equation(task)
    if companions(task):
        for part in _parts(task):
            if pairs := companions(part):
                yield equation(part, pairs)


def _parts(task: FiniteTask) -> Iterable[FiniteTask]:
    """The task restricted to what each part of the goal depends on; goal parts with the same dependencies share a subtask."""
    subtasks: dict[tuple[tuple[str, ...], ...], FiniteTask] = {}
    for variable, value in task.goal:
        if task.initial[variable] != value:
            part = prune_irrelevant(replace(task, goal=((variable, value),)))
            subtask = subtasks.get(part.names)
            subtasks[part.names] = replace(part, goal=(*subtask.goal, *part.goal)) if subtask else part
    return subtasks.values()


def is_unsatisfiable(state_equation: Equation) -> bool:
    """Whether no operation counts satisfy the equation. Minimizes the sum of the counts: the solver then starts from zero, and is many
    times faster than without an objective."""
    if not state_equation.cases:
        return max(state_equation.least) > 0
    rows, columns, changes = ([term[place] for term in state_equation.terms] for place in range(3))
    matrix = csr_array((changes, (rows, columns)), shape=(len(state_equation.least), len(state_equation.cases)), dtype=float)
    result = linprog([1.0] * len(state_equation.cases), A_ub=-matrix, b_ub=[-least for least in state_equation.least], method="highs")
    return bool(result.status == INFEASIBLE)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))

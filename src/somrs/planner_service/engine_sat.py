"""A process that plans by satisfiability (`planner/encodings/satisfiability.py`), with the solvers of PySAT (https://pysathq.github.io).

`python -m somrs.planner_service.engine_sat TASK PLAN SOLVER FIRST GROWTH [busy]` tries plans of FIRST steps more than the lower bound,
then of GROWTH times as many steps, and so on. With `busy`, each device performs at most one operation in a step. The process cannot prove
that there is no plan.
"""

from __future__ import annotations

import sys
from pathlib import Path

from pysat.solvers import Solver

from somrs.planner.encodings.sas import parse_sas
from somrs.planner.encodings.satisfiability import Clauses

LITERALS = 4_000_000
"""The maximum number of literals: a larger task is hard by its size, where SAT solvers do not help."""


def main(task: str, plan: str, solver: str, first: str, growth: str, busy: str = "") -> int:
    with Solver(name=solver) as sat:
        clauses = Clauses(parse_sas(Path(task).read_text(encoding="ascii")), sat.add_clause, busy=bool(busy))
        if clauses.least is None:
            return 1
        steps = clauses.least + int(first)
        while clauses.literals < LITERALS:
            while clauses.steps < steps:
                clauses.extend()
            if sat.solve(assumptions=clauses.goal_assumptions(steps)):
                true = {literal for literal in sat.get_model() if literal > 0}
                unfinished = Path(plan + ".part")
                unfinished.write_text("".join(f"({move})\n" for move in clauses.plan(true, steps)), encoding="ascii")
                unfinished.rename(plan)
                return 0
            steps = max(steps + 1, int(steps * float(growth)))
    return 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

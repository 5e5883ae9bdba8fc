"""A process that plans by satisfiability (`planner/encodings/satisfiability.py`), with the solvers of PySAT (https://pysathq.github.io).

`python -m somrs.planner_service.engine_sat TASK PLAN SOLVER FIRST GROWTH [busy]`: for plans of as many steps as there must be at
least and FIRST
more, then of GROWTH times as many, and so on; `busy` when each device does one thing in a step. That there is no plan of any number of
steps, it cannot show.
"""

from __future__ import annotations

import sys
from pathlib import Path

from pysat.solvers import Solver

from somrs.planner.encodings.sas import parse_sas
from somrs.planner.encodings.satisfiability import Clauses

LITERALS = 4_000_000
"""More are not worth it: such a task is large for other reasons than that it is knotty."""


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

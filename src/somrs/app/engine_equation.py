"""A process that shows that there is no plan, where counting shows it (`planner/equation.py`), with the solver HiGHS of SciPy.

`python -m somrs.app.engine_equation TASK`: ends with code 11 when there is none, and with 1 when there may be one.
"""

from __future__ import annotations

import sys
from pathlib import Path

from scipy.optimize import linprog
from scipy.sparse import csr_array

from somrs.planner.equation import equation
from somrs.planner.sas import parsed

UNSOLVABLE = 11
"""As Fast Downward's exit code for the same."""
INFEASIBLE = 2
"""SciPy's status for a problem without a solution."""


def main(task: str) -> int:
    wanted = equation(parsed(Path(task).read_text(encoding="ascii")))
    rows, columns, changes = ([term[place] for term in wanted.terms] for place in range(3))
    matrix = csr_array((changes, (rows, columns)), shape=(len(wanted.facts), wanted.operations), dtype=float)
    found = linprog([0.0] * wanted.operations, A_ub=-matrix, b_ub=[-least for least in wanted.least], method="highs")
    return UNSOLVABLE if found.status == INFEASIBLE else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))

"""The numeric engine pytyr (https://github.com/planning-and-learning/tyr) in a process of its own, for tasks with counters:
`python -m somrs.planner_service.engine_counters`.

pytyr is under the GPL, so only that process imports it. It is optional; only hard tasks with counters need it.
"""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from datetime import timedelta
from typing import Any

from somrs.errors import RemoteError

GRACE = 5.0
"""Seconds beyond the time limit for the process to start and to write its result."""


def is_tyr_installed() -> bool:
    """Whether the `numbers` extra is installed."""
    return importlib.util.find_spec("pytyr") is not None


def tyr(domain: str, problem: str, seconds: float) -> list[str] | None:
    """The names of the actions of a plan; None when there is no plan. Raises RemoteError when pytyr fails or has no result in time."""
    command = [sys.executable, "-m", "somrs.planner_service.engine_counters", str(seconds)]
    try:
        request = json.dumps([domain, problem])
        process = subprocess.run(command, input=request, capture_output=True, text=True, timeout=seconds + GRACE, check=False)
    except subprocess.TimeoutExpired:
        raise RemoteError(_timeout_text(seconds)) from None
    if process.returncode:
        raise RemoteError(f"pytyr ended with code {process.returncode}: {process.stderr[-500:]}")
    answer: dict[str, Any] = json.loads(process.stdout.splitlines()[-1])
    if answer["status"] == "SOLVED":
        return [str(name) for name in answer["plan"]]
    if answer["status"] in ("UNSOLVABLE", "EXHAUSTED"):
        return None
    raise RemoteError(_timeout_text(seconds))


def _timeout_text(seconds: float) -> str:
    return f"no plan with these numbers was found in {seconds:g} s, and no proof that there is none"


def _solve(domain: str, problem: str, seconds: float) -> dict[str, object]:
    """Lazy greedy best-first search with the FF heuristic, which also prefers the actions of the relaxed plan."""
    import pytyr.formalism.planning as formalism
    from pypddl.formalism import ParserOptions
    from pytyr.planning import SearchBudget, lifted
    from pytyr.planning.lifted import gbfs_lazy
    from pyyggdrasil.execution import ExecutionContext

    options, context = ParserOptions(), ExecutionContext(1)
    task = lifted.Task(formalism.Parser(domain, None, options).parse_task(problem, None, options))
    axioms = lifted.AxiomEvaluatorFactory().create(task, context)
    states = lifted.StateRepositoryFactory().create(task)
    successors = lifted.SuccessorGeneratorFactory().create(task, context)
    search_options = gbfs_lazy.Options()
    search_options.search_budget = SearchBudget(max_time=timedelta(seconds=seconds))
    result = gbfs_lazy.find_solution(task, states, axioms, successors, lifted.FFRPGHeuristic.create(task, context), search_options)
    names = str(result.plan).replace("(", " ").replace(")", " ").split() if result.plan is not None else []
    return {"status": result.status.name, "plan": names}


if __name__ == "__main__":
    pddl_texts: list[str] = json.load(sys.stdin)
    print(json.dumps(_solve(pddl_texts[0], pddl_texts[1], float(sys.argv[1]))))

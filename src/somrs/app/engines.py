"""Whom the planner asks when a task needs more than a moment's search: engines in processes of their own, side by side.

Fast Downward (https://www.fast-downward.org) is under the GPL: it is called, never imported. It searches; beside it a SAT solver
looks for plans in which agents act at the same time (`engine_sat.py`), which is another way to be good. Each works without the
other, and everything but hard planning without both.
"""

from __future__ import annotations

import importlib.util
import sys
import tempfile
from pathlib import Path

from somrs.app.engine_race import Entrant, Won, race
from somrs.app.numbers import there, tyr
from somrs.errors import UsageError
from somrs.planner.plan import NoPlan, Plan
from somrs.planner.planning import LIMIT, plan
from somrs.planner.problem import Problem

UNSOLVABLE = frozenset({11, 12})
"""Fast Downward's exit codes for: proved unsolvable; searched through without finding a solution. 12 comes from incomplete
searches too, but those used here are complete."""
FIRST = 0.25
"""The part of the time after which the first search makes room: most that it finds it finds within seconds."""

_ESTIMATES = """let(landmarks, eval_modify_costs(landmark_sum(lm_factory=lm_reasonable_orders_hps(lm_rhw()), pref=true), cost_type=one),
let(ff, eval_modify_costs(ff(), cost_type=one), {}))"""
THREE = _ESTIMATES.format(
    """let(contexts, eval_modify_costs(cea(), cost_type=one),
lazy_greedy([ff, contexts, landmarks], preferred=[contexts, ff, landmarks], cost_type=one, reopen_closed=false))"""
)
"""The first search of LAMA (Richter and Westphal 2010), with what helps landmarks preferred, too, and with a third estimate that
follows what each variable depends on (Helmert and Geffner 2008): the more different ways of seeing, the fewer plateaus."""
EXPLORING = _ESTIMATES.format(
    """lazy(alt([single(ff), single(ff, pref_only=true), single(landmarks), single(landmarks, pref_only=true),
type_based([ff, g()])], boost=1000), preferred=[ff, landmarks], cost_type=one, reopen_closed=false)"""
)
"""Two of them with type-based exploration (Xie, Müller, Holte and Imai 2014), where the estimates mislead."""


def plan_in_process(problem: object, limit: float = LIMIT) -> Plan | NoPlan:
    """Carry out a Task Manager's Ask for a plan. To be called in a process that can be waited for."""
    if not isinstance(problem, Problem):
        raise TypeError(f"a planning problem was expected, not {type(problem).__name__}")
    return plan(problem, solved if entrants() else None, limit, numeric=tyr if there() else None)


def solved(task: str, seconds: float) -> list[str] | None:
    """The names of the operators of a plan, by whoever finds one first; None when there is no plan. Raises RemoteError when
    there is no answer in time."""
    won = raced(task, seconds, entrants())
    return list(won.operators) if won.operators is not None else None


def raced(task: str, seconds: float, engines: list[Entrant]) -> Won:
    """The same, with who it was, among these engines."""
    if not engines:
        raise UsageError("planning tasks of many steps needs an engine: pip install 'somrs[planner]'")
    with tempfile.TemporaryDirectory(prefix="somrs-plan-") as place:
        file = Path(place) / "task.sas"
        file.write_text(task, encoding="ascii")
        return race(engines, file, seconds)


def entrants() -> list[Entrant]:
    """The engines that are installed, in the order in which they take part."""
    found = driver()
    searches = [_searching(found, "estimates", THREE, FIRST), _searching(found, "exploring", EXPLORING, 1.0)] if found else []
    solvers = [_solving("glucose4", 0), _solving("glucose4", 1)] if importlib.util.find_spec("pysat") is not None else []
    return [*searches[:1], *solvers, *searches[1:]]


def driver() -> Path | None:
    """Fast Downward's search program, if the `planner` extra is installed."""
    found = importlib.util.find_spec("up_fast_downward")  # looks for the package without running it
    if found is None or found.origin is None:
        return None
    path = Path(found.origin).parent / "downward" / "builds" / "release" / "bin" / "downward"
    return path if path.exists() else None


def _searching(program: Path, name: str, search: str, share: float) -> Entrant:
    def command(task: Path, plan: Path) -> list[str]:
        return [str(program), "--internal-plan-file", str(plan), "--search", search.replace("\n", " ")]

    return Entrant(name=name, command=command, share=share, proves=UNSOLVABLE)


def _solving(solver: str, more: int) -> Entrant:
    def command(task: Path, plan: Path) -> list[str]:
        return [sys.executable, "-m", "somrs.app.engine_sat", str(task), str(plan), solver, str(more)]

    return Entrant(name=f"steps+{more}", command=command)

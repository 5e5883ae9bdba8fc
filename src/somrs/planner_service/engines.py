"""Whom the planner asks when a task needs more than a moment's search: engines in processes of their own, side by side.

Fast Downward (https://www.fast-downward.org) is under the GPL: it is called, never imported. It searches; beside it a SAT solver
looks for plans in which agents act at the same time (`engine_sat.py`), which is another way to be good; and counting shows of some tasks
that there is no plan (`engine_equation.py`). Each works without the others, and everything but hard planning without all of them.
"""

from __future__ import annotations

import importlib.util
import sys
import tempfile
import time
from pathlib import Path

from somrs.errors import UsageError
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import Problem
from somrs.planner.planning import LIMIT, plan
from somrs.planner_service.engine_counters import is_tyr_installed, tyr
from somrs.planner_service.engine_race import EngineResult, Entrant, race, run_all

UNSOLVABLE = frozenset({11, 12})
"""Fast Downward's exit codes for: proved unsolvable; searched through without finding a solution. 12 comes from incomplete
searches too, but those used here are complete."""
FIRST_SHARE = 0.25
"""The part of the time after which the first search makes room: most that it finds it finds within seconds."""

COUNTING_SHARE = 0.1
"""The part of the time that counting has; where it shows anything, it mostly takes a second."""

_ESTIMATES = """let(landmarks, eval_modify_costs(landmark_sum(lm_factory=lm_reasonable_orders_hps(lm_rhw()), pref=true), cost_type=one),
let(ff, eval_modify_costs(ff(), cost_type=one), {}))"""
FIRST_SEARCH = _ESTIMATES.format(
    """let(contexts, eval_modify_costs(cea(), cost_type=one),
lazy_greedy([ff, contexts, landmarks], preferred=[contexts, ff, landmarks], cost_type=one, reopen_closed=false))"""
)
"""The first search of LAMA (Richter and Westphal 2010), with what helps landmarks preferred, too, and with a third estimate that
follows what each variable depends on (Helmert and Geffner 2008): the more different ways of seeing, the fewer plateaus."""
EXPLORING_SEARCH = _ESTIMATES.format(
    """lazy(alt([single(ff), single(ff, pref_only=true), single(landmarks), single(landmarks, pref_only=true),
type_based([ff, g()])], boost=1000), preferred=[ff, landmarks], cost_type=one, reopen_closed=false)"""
)
"""Two of them with type-based exploration (Xie, Müller, Holte and Imai 2014), where the estimates mislead."""

CHEAP_SEARCH = """let(landmarks, landmark_sum(lm_factory=lm_reasonable_orders_hps(lm_rhw()), pref=true),
let(ff, ff(), lazy_wastar([ff, landmarks], preferred=[ff, landmarks], w=3)))"""
"""The later searches of LAMA, which mind what steps cost."""

SPARE_GROWTH, SOONEST_GROWTH = 1.4, 1.1
"""So many times as many steps are tried next: a plan with steps to spare is found faster than one with none, which is done sooner."""

LEAST_BETTER, MOST_BETTER = 2.0, 20.0
"""Seconds in which a better plan than the first is looked for."""


def plan_in_process(problem: object, limit: float = LIMIT) -> Plan | NoPlan:
    """Carry out a Task Manager's Ask for a plan. To be called in a process that can be waited for."""
    if not isinstance(problem, Problem):
        raise TypeError(f"a planning problem was expected, not {type(problem).__name__}")
    started_at = time.monotonic()

    def improve(task: str, hurry: bool) -> list[list[str]]:
        """For twice as long as the first plan took, within bounds."""
        spent = time.monotonic() - started_at
        return improve_plan(task, hurry, min(max(2 * spent, LEAST_BETTER), MOST_BETTER, limit - spent))

    return plan(problem, solve if entrants() else None, limit, tyr if is_tyr_installed() else None, improve)


def solve(task: str, seconds: float) -> list[str] | None:
    """The names of the operators of a plan, by whoever finds one first; None when there is no plan. Raises RemoteError when
    there is no answer in time."""
    result = race_engines(task, seconds, entrants())
    return list(result.operators) if result.operators is not None else None


def race_engines(task: str, seconds: float, engines: list[Entrant]) -> EngineResult:
    """The same, with who it was, among these engines."""
    if not engines:
        raise UsageError("planning tasks of many steps needs an engine: pip install 'somrs[planner]'")
    with tempfile.TemporaryDirectory(prefix="somrs-plan-") as place:
        file = Path(place) / "task.sas"
        file.write_text(task, encoding="ascii")
        return race(engines, file, seconds)


def improve_plan(task: str, hurry: bool, seconds: float) -> list[list[str]]:
    """Other plans than the first one: with as many agents at work at the same time as there can be, which are often short ones, too;
    and, if there is no hurry, one that is cheap."""
    if seconds <= 0:
        return []
    engines = [_sat_entrant("glucose4", 0, SOONEST_GROWTH)] if importlib.util.find_spec("pysat") is not None else []
    if hurry and engines:
        engines.append(_sat_entrant("glucose4", 0, SOONEST_GROWTH, "busy"))
    elif not hurry and (program := driver()) is not None:
        engines.append(_search_entrant(program, "cheap", CHEAP_SEARCH, 1.0))
    with tempfile.TemporaryDirectory(prefix="somrs-plan-") as place:
        file = Path(place) / "task.sas"
        file.write_text(task, encoding="ascii")
        return [list(result.operators) for result in run_all(engines, file, seconds) if result.operators is not None]


def entrants() -> list[Entrant]:
    """The engines that are installed, in the order in which they take part."""
    program = driver()
    searches = (
        [_search_entrant(program, "estimates", FIRST_SEARCH, FIRST_SHARE), _search_entrant(program, "exploring", EXPLORING_SEARCH, 1.0)]
        if program
        else []
    )
    solvers = (
        [_sat_entrant("glucose4", 0, SPARE_GROWTH), _sat_entrant("glucose4", 1, SPARE_GROWTH)]
        if importlib.util.find_spec("pysat") is not None
        else []
    )
    return [*searches[:1], *_counting_entrants(), *solvers, *searches[1:]]


def driver() -> Path | None:
    """Fast Downward's search program, if the `planner` extra is installed."""
    spec = importlib.util.find_spec("up_fast_downward")  # looks for the package without running it
    if spec is None or spec.origin is None:
        return None
    path = Path(spec.origin).parent / "downward" / "builds" / "release" / "bin" / "downward"
    return path if path.exists() else None


def _search_entrant(program: Path, name: str, search: str, share: float) -> Entrant:
    def command(task: Path, plan: Path) -> list[str]:
        return [str(program), "--internal-plan-file", str(plan), "--search", search.replace("\n", " ")]

    return Entrant(name=name, command=command, share=share, proves=UNSOLVABLE)


def _counting_entrants() -> list[Entrant]:
    if importlib.util.find_spec("scipy") is None:
        return []

    def command(task: Path, plan: Path) -> list[str]:
        return [sys.executable, "-m", "somrs.planner_service.engine_equation", str(task)]

    return [Entrant(name="counting", command=command, share=COUNTING_SHARE, proves=UNSOLVABLE)]


def _sat_entrant(solver: str, spare_steps: int, growth: float, *flags: str) -> Entrant:
    def command(task: Path, plan: Path) -> list[str]:
        return [
            sys.executable,
            "-m",
            "somrs.planner_service.engine_sat",
            str(task),
            str(plan),
            solver,
            str(spare_steps),
            str(growth),
            *flags,
        ]

    return Entrant(name=f"steps+{spare_steps}", command=command)

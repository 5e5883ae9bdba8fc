"""The engines for tasks that need a longer search. Each runs in a process of its own, and several run in parallel.

Fast Downward (https://www.fast-downward.org) does heuristic search; it is under the GPL, so it is called as a program and never imported.
A SAT solver looks for plans in which agents act at the same time (`engine_sat.py`). The state equation proves for some tasks that there is
no plan (`engine_equation.py`). Every engine is optional; only hard tasks need one.
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
"""Fast Downward's exit codes for a task proved unsolvable (11) and for an exhausted search without a plan (12). Incomplete searches also
end with 12, but the searches used here are complete."""
CONTEXTS_SHARE, LANDMARKS_SHARE = 0.12, 0.22
"""The shares of the time limit for the two searches that solve most tasks, if other engines wait."""

BRIEF_SHARE = 0.08
"""The share of the time limit of a brief search, if other engines wait."""

COUNTING_SHARE = 0.1
"""The share of the time limit for the state equation, if other engines wait: a proof mostly takes about a second."""

_ESTIMATES = """let(landmarks, eval_modify_costs(landmark_sum(lm_factory=lm_reasonable_orders_hps(lm_rhw()), pref=true), cost_type=one),
let(ff, eval_modify_costs(ff(), cost_type=one), {}))"""
LANDMARKS_SEARCH = _ESTIMATES.format("lazy_greedy([ff, landmarks], preferred=[ff, landmarks], cost_type=one, reopen_closed=false)")
"""The first search of LAMA (Richter and Westphal 2010), with preferred operators of the landmark heuristic, too."""
CONTEXTS_SEARCH = _ESTIMATES.format(
    """let(contexts, eval_modify_costs(cea(), cost_type=one),
lazy_greedy([ff, contexts, landmarks], preferred=[contexts, ff, landmarks], cost_type=one, reopen_closed=false))"""
)
"""The same with the context-enhanced additive heuristic (Helmert and Geffner 2008), too: more diverse heuristics mean fewer
plateaus, but fewer states in the same time."""
EXPLORING_SEARCH = _ESTIMATES.format(
    """lazy(alt([single(ff), single(ff, pref_only=true), single(landmarks), single(landmarks, pref_only=true),
type_based([ff, g()])], boost=1000), preferred=[ff, landmarks], cost_type=one, reopen_closed=false)"""
)
"""The FF and landmark heuristics with type-based exploration (Xie, Müller, Holte and Imai 2014), for tasks where heuristics mislead."""
EXPLORING_CONTEXTS_SEARCH = _ESTIMATES.format(
    """let(contexts, eval_modify_costs(cea(), cost_type=one),
lazy(alt([single(contexts), single(contexts, pref_only=true), single(landmarks), single(landmarks, pref_only=true),
type_based([contexts, g()])], boost=1000), preferred=[contexts, landmarks], cost_type=one, reopen_closed=false))"""
)
"""The same exploration with the context-enhanced heuristic: it depends less on the order of the operators than any other search here
(docs/decisions/0062)."""

GOAL_COUNT_SEARCH = "lazy_greedy([goalcount()], cost_type=one, reopen_closed=false)"
"""Towards states in which more parts of the goal hold: a second is enough where thousands of parts hold one after another."""
LANDMARK_COUNT_SEARCH = """let(landmarks,
eval_modify_costs(landmark_sum(lm_factory=lm_reasonable_orders_hps(lm_rhw()), pref=true), cost_type=one),
lazy_greedy([landmarks], preferred=[landmarks], cost_type=one, reopen_closed=false))"""
"""Landmarks alone, which take little time for a state, for tasks in which relaxed plans say little, such as robots that slide to a wall."""
RELAXED_PLAN_SEARCH = """let(ff, eval_modify_costs(ff(), cost_type=one),
lazy_greedy([ff], preferred=[ff], cost_type=one, reopen_closed=false))"""
"""The FF heuristic alone: it sees more states in the same time, and is not misled by landmarks that have to be reached more than once."""
CAUSAL_GRAPH_SEARCH = """let(graph, eval_modify_costs(cg(), cost_type=one),
lazy_greedy([graph], preferred=[graph], cost_type=one, reopen_closed=false))"""
"""The causal graph heuristic (Helmert 2004), for tasks of many objects that move in the same way, such as cars that are parked anew."""

SHUFFLES = 6
"""The number of shuffled searches. The time of a greedy search has a heavy tail: on one task, it takes a second with most orders of the
operators, and longer than anyone waits with the others. Brief searches with several orders therefore find more than one long search
(Gomes, Selman and Kautz 1998)."""


def _shuffled_search(number: int) -> str:
    """The search with landmarks, and the operators in a random order; every other one prefers helpful ones."""
    preferred_first = "true" if number % 2 else "false"
    return _ESTIMATES.format(
        f"""lazy_greedy([ff, landmarks], preferred=[ff, landmarks], cost_type=one, reopen_closed=false, randomize_successors=true,
preferred_successors_first={preferred_first}, random_seed={number})"""
    )


CHEAP_SEARCH = """let(landmarks, landmark_sum(lm_factory=lm_reasonable_orders_hps(lm_rhw()), pref=true),
let(ff, ff(), lazy_wastar([ff, landmarks], preferred=[ff, landmarks], w=3)))"""
"""A later search of LAMA, which takes the cost of steps into account."""

LEAST_SHARE = 0.2
"""The share of the time limit that engines have at least, however long the planner took to state the task."""

SPARE_GROWTH, SOONEST_GROWTH = 1.4, 1.1
"""The factors by which the number of steps grows between attempts of the SAT engine. A plan with spare steps is found faster; a plan
without is done sooner."""

LEAST_BETTER, MOST_BETTER = 2.0, 20.0
"""The bounds, in seconds, of the time to look for a better plan than the first."""


def plan_in_process(problem: object, limit: float = LIMIT) -> Plan | NoPlan:
    """Plan with all installed engines; `limit` is in seconds. It blocks, so it is called in the planner's process."""
    if not isinstance(problem, Problem):
        raise TypeError(f"a planning problem was expected, not {type(problem).__name__}")
    started_at = time.monotonic()

    def improve(task: str, hurry: bool) -> list[list[str]]:
        """Look for better plans for twice the time that the first plan took, within bounds. The plan still has to be completed then."""
        spent = time.monotonic() - started_at
        return _improve_plan(task, hurry, min(max(2 * spent, LEAST_BETTER), MOST_BETTER, (limit - spent) / 2))

    def solve_in_time(task: str, seconds: float) -> list[str] | None:
        """Look for a plan for so long, or in what is left of the time."""
        return solve(task, max(min(seconds, limit - (time.monotonic() - started_at)), seconds * LEAST_SHARE))

    def is_overdue() -> bool:
        return time.monotonic() - started_at > limit

    return plan(problem, solve_in_time if entrants() else None, limit, tyr if is_tyr_installed() else None, improve, is_overdue)


def solve(task: str, seconds: float) -> list[str] | None:
    """The operator names of the first plan that an engine finds; None when there is no plan. Raises RemoteError when no engine has a
    result in time."""
    result = race_engines(task, seconds, entrants())
    return list(result.operators) if result.operators is not None else None


def race_engines(task: str, seconds: float, engines: list[Entrant]) -> EngineResult:
    """The first result of the given engines, with the engine's name.

    Raises:
        UsageError: if there is no engine.
        RemoteError: if no engine has a result in time.
    """
    if not engines:
        raise UsageError("planning tasks of many steps needs an engine: pip install 'somrs[planner]'")
    with tempfile.TemporaryDirectory(prefix="somrs-plan-") as place:
        file = Path(place) / "task.sas"
        file.write_text(task, encoding="ascii")
        return race(engines, file, seconds)


def _improve_plan(task: str, hurry: bool, seconds: float) -> list[list[str]]:
    """Further plans for a task: one with as many agents at work in parallel as possible, which is often short, too; and, if `hurry` is
    False, a cheap one."""
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
    """The installed engines, in the order in which they start."""
    solvers = [_sat_entrant("glucose4", extra, SPARE_GROWTH) for extra in (0, 1)] if importlib.util.find_spec("pysat") is not None else []
    program = driver()
    if program is None:
        return [*_counting_entrants(), *solvers]
    shuffled = [_search_entrant(program, f"shuffled {number}", _shuffled_search(number), BRIEF_SHARE) for number in range(SHUFFLES)]
    return [
        _search_entrant(program, "contexts", CONTEXTS_SEARCH, CONTEXTS_SHARE),
        *_counting_entrants(),
        *solvers[:1],
        _search_entrant(program, "goal count", GOAL_COUNT_SEARCH, 0.03),
        _search_entrant(program, "exploring contexts", EXPLORING_CONTEXTS_SEARCH, BRIEF_SHARE),
        _search_entrant(program, "causal graph", CAUSAL_GRAPH_SEARCH, BRIEF_SHARE),
        _search_entrant(program, "landmark count", LANDMARK_COUNT_SEARCH, 0.03),
        _search_entrant(program, "landmarks", LANDMARKS_SEARCH, LANDMARKS_SHARE),
        _search_entrant(program, "relaxed plan", RELAXED_PLAN_SEARCH, BRIEF_SHARE),
        *shuffled[:3],
        *solvers[1:],
        *shuffled[3:],
        _search_entrant(program, "exploring", EXPLORING_SEARCH, 1.0),
    ]


def driver() -> Path | None:
    """The path of Fast Downward's search program; None unless the `planner` extra is installed."""
    spec = importlib.util.find_spec("up_fast_downward")  # finds the package without importing it
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

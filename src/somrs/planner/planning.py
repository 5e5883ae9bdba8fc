"""From a problem to an abstract plan: at once where that can be, else relevance, grounding, search, and why there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from somrs.entish.formula import names
from somrs.errors import RemoteError, SomrsError
from somrs.ontology.truth import formula_holds
from somrs.planner.encodings.sas import decode_moves, encode_sas
from somrs.planner.explanation import explain_failure, not_usable, unmet_precondition
from somrs.planner.grounding.grounding import Grounding, TooLarge
from somrs.planner.grounding.merging import merge_task
from somrs.planner.grounding.relevance import demands
from somrs.planner.grounding.task import Move, Task
from somrs.planner.model.operators import Inexpressible, Operator, goal_operators
from somrs.planner.model.plan import NoPlan, Obstacle, Plan
from somrs.planner.model.problem import Problem
from somrs.planner.model.provider_choice import generalize_providers
from somrs.planner.model.quality import best
from somrs.planner.model.world import World
from somrs.planner.repair import prefer_repaired, prefer_shorter
from somrs.planner.search import counting
from somrs.planner.search.counting import Counters, CountingFailed, search_with_counters
from somrs.planner.search.matching import match
from somrs.planner.search.numeric import NumericTask
from somrs.planner.search.search import TooHard, cheapest, remove_redundant_moves
from somrs.planner.search.steps import build_plan

Engine = Callable[[str, float], list[str] | None]
"""Given a task in Fast Downward's format and a limit in seconds: the names of the operators that solve it, or None when
there are none. Raises SomrsError when it could not find out."""

VALUES = 5_000
"""Where services calculate, so many actions with a value each are listed; then the values are counted with."""
STATES = 5_000
"""Of facts and numbers: so many are looked at before an engine is asked, in a second or two."""
ALL_STATES = 50_000
"""The same where there is no such engine: half a minute at the most."""
NumericEngine = Callable[[str, str, float], list[str] | None]
"""The same for a task in numeric PDDL, its domain and its problem: the names of the actions."""

Improver = Callable[[str, bool], list[list[str]]]
"""Given the same as an Engine, and whether it is to be done soon rather than cheaply: other plans, as far as they are found soon."""

LONG = 10
"""A plan of so many steps is worth looking for a better one."""

LIMIT = 30.0
"""Seconds that an engine may take."""


@dataclass(frozen=True, slots=True)
class Engines:
    """Who is asked when a search takes longer, and for how many seconds each."""

    search: Engine | None
    numeric: NumericEngine | None
    improver: Improver | None
    limit: float


def plan_quickly(problem: Problem) -> Plan | NoPlan | None:
    """What can be said of the problem within a few milliseconds; None when it has to be searched."""
    try:
        result = _check_map(problem)
        if result is not None:
            return result
        short = match(problem, *_compile_problem(problem))
        if short is not None and len(short.steps) >= LONG:
            short = None  # a better one is worth a search
        return generalize_providers(problem, prefer_repaired(problem, short))
    except Inexpressible as inexpressible:
        return _report_inexpressible(inexpressible)


def plan(
    problem: Problem,
    engine: Engine | None = None,
    limit: float = LIMIT,
    numeric: NumericEngine | None = None,
    improver: Improver | None = None,
) -> Plan | NoPlan:
    """A plan that makes the goal true on the map, or why there is none; what still stands of the plan before, if that is as short."""
    if (result := plan_quickly(problem)) is not None:
        return result
    return generalize_providers(problem, prefer_shorter(problem, _plan(problem, Engines(engine, numeric, improver, limit))))


def _plan(problem: Problem, engines: Engines) -> Plan | NoPlan:
    try:
        return _search_plan(problem, *_compile_problem(problem), engines)
    except Inexpressible as inexpressible:
        return _report_inexpressible(inexpressible)
    except (TooLarge, CountingFailed) as large:
        return NoPlan(explanation=f"this is too large to be searched: {large}", undecided=True)
    except TooHard as hard:
        explanation = f"this takes a longer search ({hard}); install the engine for it: pip install 'somrs[planner]'"
        return NoPlan(explanation=explanation, undecided=True)
    except SomrsError as error:
        return NoPlan(explanation=f"no plan was found: {error}", undecided=True)


def _check_map(problem: Problem) -> Plan | NoPlan | None:
    """What the map says already."""
    unmet = unmet_precondition(problem)
    if unmet is not None:
        return unmet
    if not formula_holds(problem.goal, problem.map, problem.ontology):
        return None
    doubtful = [name for name in names(problem.goal) if name in problem.excluded]
    if doubtful:
        return NoPlan(explanation=f"{problem.goal}: {not_usable(doubtful[0])}", obstacles=(Obstacle.PROMISED,))
    return Plan()


def _compile_problem(problem: Problem) -> tuple[World, list[Operator]]:
    world = World(problem)
    return world, list(goal_operators(problem.goal, world.vocabulary))


def _report_inexpressible(inexpressible: Inexpressible) -> NoPlan:
    return NoPlan(explanation=f"this cannot be planned for: {inexpressible}", undecided=True)


def _search_plan(problem: Problem, world: World, goals: list[Operator], engines: Engines) -> Plan | NoPlan:
    """By what is likely to help first, then by all that can help: only that may show that there is no plan."""
    max_actions = VALUES if world.vocabulary.calculates else None
    try:
        for narrow in (True, False):
            grounding = Grounding(world, demands(goals, world, narrow=narrow), narrow=narrow, max_actions=max_actions)
            if grounding.is_goal_reachable:
                task = Task(grounding)
                moves = _solve(task, engines)
                if moves is not None:
                    return _improve_plan(problem, build_plan(problem, remove_redundant_moves(moves, task)), task, engines)
    except TooLarge:
        if not world.vocabulary.calculates:
            raise
        return _plan_with_counters(problem, engines)
    return explain_failure(problem, world, grounding.guessed)


def _improve_plan(problem: Problem, first_plan: Plan, task: Task, engines: Engines) -> Plan:
    """A better plan, if one is found soon: the first one is whatever came first. Nobody looks for one when something went wrong on the
    way: devices stand and wait then."""
    if engines.improver is None or len(first_plan.steps) < LONG or problem.rest:
        return first_plan
    other_plans = engines.improver(encode_sas(merge_task(task)), problem.hurry)
    return best(
        problem, [first_plan, *(build_plan(problem, remove_redundant_moves(decode_moves(names, task), task)) for names in other_plans)]
    )


def _plan_with_counters(problem: Problem, engines: Engines) -> Plan | NoPlan:
    """The same with numbers beside the facts, where they may come to more values than can be listed."""
    world = World(problem, counting=True)
    goals = list(goal_operators(problem.goal, world.vocabulary))
    for narrow in (True, False):
        grounding = Grounding(world, demands(goals, world, narrow=narrow), narrow=narrow)
        if grounding.is_goal_reachable:
            task = Task(grounding)
            counters = Counters(task, world)
            moves = _solve_with_counters(task, counters, engines)
            if moves is not None:
                return build_plan(problem, counting.remove_redundant_moves(moves, task, counters))
    return explain_failure(problem, world, grounding.guessed)


def _solve_with_counters(task: Task, counters: Counters, engines: Engines) -> list[Move] | None:
    try:
        return search_with_counters(task, counters, STATES if engines.numeric is not None else ALL_STATES)
    except CountingFailed as error:
        if engines.numeric is None:
            raise CountingFailed(f"{error}; install the engine for numbers: pip install 'somrs[numbers]'") from None
    numeric_task = NumericTask(task, counters)
    names = engines.numeric(numeric_task.domain, numeric_task.problem, engines.limit)
    if names is None:
        return None
    moves = numeric_task.decode_moves(names)
    if not counting.reaches_goal(moves, task, counters):
        raise CountingFailed("the plan that the engine for numbers found is none when it is calculated exactly")
    return moves


def _solve(task: Task, engines: Engines) -> list[Move] | None:
    try:
        return cheapest(task)
    except TooHard as hard:
        if engines.search is None:
            raise
        try:
            names = engines.search(encode_sas(merge_task(task)), engines.limit)
        except SomrsError as error:
            raise RemoteError(f"{error}; of the short search before it, {hard}") from error
    return decode_moves(names, task) if names is not None else None

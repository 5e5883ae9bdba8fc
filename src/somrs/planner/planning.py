"""From a problem to an abstract plan: at once where that can be, else relevance, grounding, search, and why there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from somrs.entish.formula import names
from somrs.errors import RemoteError, SomrsError
from somrs.ontology.truth import formula_holds
from somrs.planner.encodings.sas import read, written
from somrs.planner.explanation import not_usable, unmet_precondition, why_not
from somrs.planner.grounding.grounding import Grounding, TooLarge
from somrs.planner.grounding.merging import merged
from somrs.planner.grounding.relevance import demands
from somrs.planner.grounding.task import Move, Task
from somrs.planner.model.choice import opened
from somrs.planner.model.operators import Inexpressible, Operator, goal_operators
from somrs.planner.model.plan import NoPlan, Obstacle, Plan
from somrs.planner.model.problem import Problem
from somrs.planner.model.quality import best
from somrs.planner.model.world import World
from somrs.planner.repair import shorter, sure
from somrs.planner.search import counting
from somrs.planner.search.counting import Counters, TooMany, count
from somrs.planner.search.matching import match
from somrs.planner.search.numeric import NumericTask
from somrs.planner.search.search import TooHard, cheapest, without_useless
from somrs.planner.search.steps import stated

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

Better = Callable[[str, bool], list[list[str]]]
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
    better: Better | None
    limit: float


def quick(problem: Problem) -> Plan | NoPlan | None:
    """What can be said of the problem within a few milliseconds; None when it has to be searched."""
    try:
        said = _said(problem)
        if said is not None:
            return said
        short = match(problem, *_stated(problem))
        if short is not None and len(short.steps) >= LONG:
            short = None  # a better one is worth a search
        return opened(problem, sure(problem, short))
    except Inexpressible as inexpressible:
        return _beyond(inexpressible)


def plan(
    problem: Problem,
    engine: Engine | None = None,
    limit: float = LIMIT,
    numeric: NumericEngine | None = None,
    better: Better | None = None,
) -> Plan | NoPlan:
    """A plan that makes the goal true on the map, or why there is none; what still stands of the plan before, if that is as short."""
    if (found := quick(problem)) is not None:
        return found
    return opened(problem, shorter(problem, _plan(problem, Engines(engine, numeric, better, limit))))


def _plan(problem: Problem, engines: Engines) -> Plan | NoPlan:
    try:
        return _searched(problem, *_stated(problem), engines)
    except Inexpressible as inexpressible:
        return _beyond(inexpressible)
    except (TooLarge, TooMany) as large:
        return NoPlan(explanation=f"this is too large to be searched: {large}", undecided=True)
    except TooHard as hard:
        explanation = f"this takes a longer search ({hard}); install the engine for it: pip install 'somrs[planner]'"
        return NoPlan(explanation=explanation, undecided=True)
    except SomrsError as error:
        return NoPlan(explanation=f"no plan was found: {error}", undecided=True)


def _said(problem: Problem) -> Plan | NoPlan | None:
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


def _stated(problem: Problem) -> tuple[World, list[Operator]]:
    world = World(problem)
    return world, list(goal_operators(problem.goal, world.known))


def _beyond(inexpressible: Inexpressible) -> NoPlan:
    return NoPlan(explanation=f"this cannot be planned for: {inexpressible}", undecided=True)


def _searched(problem: Problem, world: World, goals: list[Operator], engines: Engines) -> Plan | NoPlan:
    """By what is likely to help first, then by all that can help: only that may show that there is no plan."""
    most = VALUES if world.known.calculates else None
    try:
        for narrow in (True, False):
            grounding = Grounding(world, demands(goals, world, narrow=narrow), narrow=narrow, most=most)
            if grounding.reached:
                task = Task(grounding)
                moves = _solve(task, engines)
                if moves is not None:
                    return _bettered(problem, stated(problem, without_useless(moves, task)), task, engines)
    except TooLarge:
        if not world.known.calculates:
            raise
        return _counted(problem, engines)
    return why_not(problem, world, grounding.guessed)


def _bettered(problem: Problem, found: Plan, task: Task, engines: Engines) -> Plan:
    """A better plan, if one is found soon: the first one is whatever came first. Nobody looks for one when something went wrong on the
    way: devices stand and wait then."""
    if engines.better is None or len(found.steps) < LONG or problem.rest:
        return found
    others = engines.better(written(merged(task)), problem.hurry)
    return best(problem, [found, *(stated(problem, without_useless(read(names, task), task)) for names in others)])


def _counted(problem: Problem, engines: Engines) -> Plan | NoPlan:
    """The same with numbers beside the facts, where they may come to more values than can be listed."""
    world = World(problem, counting=True)
    goals = list(goal_operators(problem.goal, world.known))
    for narrow in (True, False):
        grounding = Grounding(world, demands(goals, world, narrow=narrow), narrow=narrow)
        if grounding.reached:
            task = Task(grounding)
            counters = Counters(task, world)
            moves = _count(task, counters, engines)
            if moves is not None:
                return stated(problem, counting.without_useless(moves, task, counters))
    return why_not(problem, world, grounding.guessed)


def _count(task: Task, counters: Counters, engines: Engines) -> list[Move] | None:
    try:
        return count(task, counters, STATES if engines.numeric is not None else ALL_STATES)
    except TooMany as many:
        if engines.numeric is None:
            raise TooMany(f"{many}; install the engine for numbers: pip install 'somrs[numbers]'") from None
    asked = NumericTask(task, counters)
    names = engines.numeric(asked.domain, asked.problem, engines.limit)
    if names is None:
        return None
    moves = asked.read(names)
    if not counting.reaches(moves, task, counters):
        raise TooMany("the plan that the engine for numbers found is none when it is calculated exactly")
    return moves


def _solve(task: Task, engines: Engines) -> list[Move] | None:
    try:
        return cheapest(task)
    except TooHard as hard:
        if engines.search is None:
            raise
        try:
            names = engines.search(written(merged(task)), engines.limit)
        except SomrsError as error:
            raise RemoteError(f"{error}; of the short search before it, {hard}") from error
    return read(names, task) if names is not None else None

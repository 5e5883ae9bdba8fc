"""From a problem to an abstract plan: at once where that can be, else relevance, grounding, search, and why there is none."""

from __future__ import annotations

from collections.abc import Callable

from somrs.entish.formula import names
from somrs.errors import RemoteError, SomrsError
from somrs.ontology.truth import holds
from somrs.planner.counting import Counters, TooMany, count, needed
from somrs.planner.explanation import not_usable, unmet_precondition, why_not
from somrs.planner.grounding import Grounding, TooLarge
from somrs.planner.matching import match
from somrs.planner.operators import Inexpressible, Operator, goal_operators
from somrs.planner.plan import NoPlan, Plan
from somrs.planner.problem import Problem
from somrs.planner.relevance import demands
from somrs.planner.repair import shorter, sure
from somrs.planner.sas import read, written
from somrs.planner.search import TooHard, search, without_useless
from somrs.planner.steps import stated
from somrs.planner.task import Move, Task
from somrs.planner.world import World

Engine = Callable[[str, float], list[str] | None]
"""Given a task in Fast Downward's format and a limit in seconds: the names of the operators that solve it, or None when
there are none. Raises SomrsError when it could not find out."""

VALUES = 5_000
"""Where services calculate, so many actions with a value each are listed; then the values are counted with."""
LIMIT = 30.0
"""Seconds that an engine may take."""


def quick(problem: Problem) -> Plan | NoPlan | None:
    """What can be said of the problem within a few milliseconds; None when it has to be searched."""
    try:
        said = _said(problem)
        return said if said is not None else sure(problem, match(problem, *_stated(problem)))
    except Inexpressible as inexpressible:
        return _beyond(inexpressible)


def plan(problem: Problem, engine: Engine | None = None, limit: float = LIMIT) -> Plan | NoPlan:
    """A plan that makes the goal true on the map, or why there is none; what still stands of the plan before, if that is as short."""
    return quick(problem) or shorter(problem, _plan(problem, engine, limit))


def _plan(problem: Problem, engine: Engine | None, limit: float) -> Plan | NoPlan:
    try:
        return _searched(problem, *_stated(problem), engine, limit)
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
    if not holds(problem.goal, problem.map, problem.ontology):
        return None
    doubtful = [name for name in names(problem.goal) if name in problem.excluded]
    return NoPlan(explanation=f"{problem.goal}: {not_usable(doubtful[0])}") if doubtful else Plan()


def _stated(problem: Problem) -> tuple[World, list[Operator]]:
    world = World(problem)
    return world, list(goal_operators(problem.goal, world.known))


def _beyond(inexpressible: Inexpressible) -> NoPlan:
    return NoPlan(explanation=f"this cannot be planned for: {inexpressible}", undecided=True)


def _searched(problem: Problem, world: World, goals: list[Operator], engine: Engine | None, limit: float) -> Plan | NoPlan:
    """By what is likely to help first, then by all that can help: only that may show that there is no plan."""
    most = VALUES if world.known.calculates else None
    try:
        for narrow in (True, False):
            grounding = Grounding(world, demands(goals, world, narrow=narrow), narrow=narrow, most=most)
            if grounding.reached:
                task = Task(grounding)
                moves = _solve(task, engine, limit)
                if moves is not None:
                    return stated(problem, without_useless(moves, task))
    except TooLarge:
        if not world.known.calculates:
            raise
        return _counted(problem)
    return why_not(problem, world, grounding.guessed)


def _counted(problem: Problem) -> Plan | NoPlan:
    """The same with numbers beside the facts, where they may come to more values than can be listed."""
    world = World(problem, counting=True)
    goals = list(goal_operators(problem.goal, world.known))
    for narrow in (True, False):
        grounding = Grounding(world, demands(goals, world, narrow=narrow), narrow=narrow)
        if grounding.reached:
            task = Task(grounding)
            counters = Counters(task, world)
            moves = count(task, counters)
            if moves is not None:
                return stated(problem, needed(moves, task, counters))
    return why_not(problem, world, grounding.guessed)


def _solve(task: Task, engine: Engine | None, limit: float) -> list[Move] | None:
    try:
        return search(task)
    except TooHard as hard:
        if engine is None:
            raise
        try:
            names = engine(written(task), limit)
        except SomrsError as error:
            raise RemoteError(f"{error}; of the short search before it, {hard}") from error
    return read(names, task) if names is not None else None

"""From a problem to an abstract plan: relevance, grounding, search, validation, causal links."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from somrs.entish import Formula, Term
from somrs.entish.formula import conjunction, names, substitute, variables
from somrs.errors import SomrsError
from somrs.ontology.objects import Map
from somrs.ontology.truth import holds
from somrs.planner.causal import linked
from somrs.planner.explanation import not_usable, unmet_precondition, why_not
from somrs.planner.grounding import Action, Grounding
from somrs.planner.operators import Inexpressible, goal_operators
from somrs.planner.plan import NoPlan, Plan, Step, after, validate
from somrs.planner.problem import Problem
from somrs.planner.relevance import demands
from somrs.planner.sas import read, written
from somrs.planner.search import TooHard, search, without_useless
from somrs.planner.task import Move, Task
from somrs.planner.world import World, as_term, rows

Engine = Callable[[str, float], list[str] | None]
"""Given a task in Fast Downward's format and a limit in seconds: the names of the operators that solve it, or None when
there are none. Raises SomrsError when it could not find out."""

LIMIT = 30.0
"""Seconds that an engine may take."""


def plan(problem: Problem, engine: Engine | None = None, limit: float = LIMIT) -> Plan | NoPlan:
    """A plan that makes the goal true on the map, or why there is none."""
    unmet = unmet_precondition(problem)
    if unmet is not None:
        return unmet
    if holds(problem.goal, problem.map, problem.ontology):
        doubtful = [name for name in names(problem.goal) if name in problem.excluded]
        return NoPlan(explanation=f"{problem.goal}: {not_usable(doubtful[0])}") if doubtful else Plan()
    try:
        world = World(problem)
        goals = list(goal_operators(problem.goal, world.known))
        for narrow in (True, False):
            grounding = Grounding(world, demands(goals, world, narrow=narrow), narrow)
            if grounding.reached:
                task = Task(grounding)
                moves = _solve(task, engine, limit)
                if moves is not None:
                    return _checked(problem, without_useless(moves, task))
        return why_not(problem, world)
    except Inexpressible as inexpressible:
        return NoPlan(explanation=f"this cannot be planned for: {inexpressible}")
    except TooHard:
        return NoPlan(explanation="this takes a search; install the engine for it: pip install 'somrs[planner]'")
    except SomrsError as error:
        return NoPlan(explanation=f"no plan was found: {error}")


def _solve(task: Task, engine: Engine | None, limit: float) -> list[Move] | None:
    try:
        return search(task)
    except TooHard:
        if engine is None:
            raise
    names = engine(written(task), limit)
    return read(names, task) if names is not None else None


def _checked(problem: Problem, moves: Sequence[Move]) -> Plan:
    steps: list[Step] = []
    maps = [problem.map]
    for move in moves:
        steps.append(_step(f"step{len(steps) + 1}", move.action, maps[-1], problem))
        maps.append(after(steps[-1], maps[-1], problem))
    made = Plan(tuple(steps), linked(steps, maps, problem))
    wrong = validate(made, problem)
    if wrong:
        raise AssertionError("; ".join(wrong))
    return made


def _step(id: str, action: Action, map: Map, problem: Problem) -> Step:
    """The action with all its formulas' variables found on the map as it is when the action starts."""
    operator = action.operator
    assert operator.service is not None, "the goal is no step"
    assert operator.effect is not None, "services have effects"
    bound: dict[str, Term] = {name: as_term(value) for name, value in action.bound.items()}
    precondition: Formula | None = None
    if operator.condition:
        wanted = conjunction(*operator.condition)
        given = {name: bound[name] for name in variables(wanted) if name in bound}
        found = next(rows(wanted, given, map, problem.ontology), None)
        if found is None:
            raise AssertionError(f"{operator.service.name} was planned where {substitute(wanted, given)} does not hold")
        bound.update(found)
        precondition = substitute(wanted, bound)
    return Step(
        id=id,
        service_type=operator.service.name,
        inputs={parameter.name: bound[parameter.name] for parameter in operator.service.inputs},
        effect=substitute(operator.effect, bound),
        precondition=precondition,
        provider=action.provider,
    )

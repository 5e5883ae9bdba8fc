"""What still stands of the plan before, when something went wrong on the way: the rest of it, if that leads to the goal from here.

Services are committed to its steps already, and a search for another plan of hundreds of steps takes its time. What is kept so costs no
more than a plan from scratch would, and what is kept.
"""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import structs

from somrs.entish.formula import names, substitute, variables
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.effects import changes, evaluate_effect
from somrs.ontology.objects import Map
from somrs.ontology.truth import bindings, formula_holds
from somrs.planner.model.causal import linked, useful
from somrs.planner.model.plan import NoPlan, Plan, Step
from somrs.planner.model.problem import Available, Problem
from somrs.planner.model.validation import after, validate


def repaired(problem: Problem) -> Plan | None:
    """The rest of the plan before, without what is so already, cannot be done any more, or serves nothing; None when that does not lead
    to the goal."""
    known = {available.service_type.name: available for available in problem.services}
    steps: list[Step] = []
    maps = [problem.map]
    try:
        for old in problem.rest:
            step = _from_here(old, maps[-1], problem, known)
            if step is not None and changes(step.effect, maps[-1], problem.ontology):
                steps.append(step)
                maps.append(after(step, maps[-1], problem))
        if not formula_holds(problem.goal, maps[-1], problem.ontology):
            return None
        kept = [steps[place] for place in useful(steps, maps, problem)]
        steps = [structs.replace(step, id=f"step{number}") for number, step in enumerate(kept, 1)]
        maps = [problem.map]
        for step in steps:
            maps.append(after(step, maps[-1], problem))
        plan = Plan(tuple(steps), linked(steps, maps, problem))
        return plan if not validate(plan, problem) else None
    except FormulaError:  # the map has lost what the plan speaks of
        return None


def _from_here(old: Step, map: Map, problem: Problem, known: Mapping[str, Available]) -> Step | None:
    """The step as it can be done on the map, if it can; what its inputs leave open may be another way by now."""
    offered = known.get(old.service_type)
    if offered is None or (old.provider is not None and old.provider not in offered.providers):
        return None
    involved = {name for term in old.inputs.values() for name in names(term)} | {old.provider}
    if not involved.isdisjoint(problem.excluded):
        return None
    service = offered.service_type
    if old.precondition is None or service.precondition is None or formula_holds(old.precondition, map, problem.ontology):
        return old
    wanted = substitute(parse(service.precondition), old.bindings)
    row = next(bindings(wanted, map, problem.ontology), None)
    if row is None or not problem.excluded.isdisjoint(name for term in row.values() for name in names(term)):
        return None
    effect = substitute(parse(service.effect), {**row, **old.bindings})
    if variables(effect):
        return None
    return structs.replace(old, precondition=substitute(wanted, row), effect=evaluate_effect(effect, map, problem.ontology))


def sure(problem: Problem, short: Plan | NoPlan | None) -> Plan | NoPlan | None:
    """The rest of the plan before, when no search is needed to know that it is worth it: all of it is promised, but for one step at most.
    Otherwise `short`, which was found without a search."""
    plan = repaired(problem) if problem.rest else None
    if plan is None or (isinstance(short, Plan) and len(short.steps) < len(plan.steps)):
        return short
    promised = [_work(step) for step in problem.rest if step.id in problem.promised]
    return plan if sum(_work(step) not in promised for step in plan.steps) <= 1 else short


def shorter(problem: Problem, found: Plan | NoPlan) -> Plan | NoPlan:
    """The rest of the plan before, unless what was found by a search has fewer steps."""
    plan = repaired(problem) if problem.rest else None
    if plan is None or (isinstance(found, Plan) and len(found.steps) < len(plan.steps)):
        return found
    return plan


def _work(step: Step) -> object:
    """What is asked of a service, whatever the step is called."""
    return step.service_type, step.inputs, step.provider

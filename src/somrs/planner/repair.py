"""Plan repair after a failure: keep the rest of the previous plan if it still leads to the goal.

Services are already committed to its steps, and a search for another plan of hundreds of steps takes long.
"""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import structs

from somrs.entish.formula import conjunction, names, substitute, variables
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.effects import changes, evaluate_effect
from somrs.ontology.map import Map
from somrs.ontology.truth import formula_holds
from somrs.planner.model.causal_links import derive_links, find_useful_steps
from somrs.planner.model.plan import NoPlan, Plan, Step
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner.model.supporting_literals import supporting_literals
from somrs.planner.model.validation import apply_step, validate


def repair_plan(problem: Problem) -> Plan | None:
    """The rest of the previous plan, without steps whose effect already holds, that are no longer applicable, or that nothing needs.
    None when this does not lead to the goal."""
    available_services = {available.service_type.name: available for available in problem.services}
    steps: list[Step] = []
    maps = [problem.map]
    try:
        for old in problem.rest:
            step = _adapt_step(_without_lapsed_condition(old, maps[-1], problem), maps[-1], problem, available_services)
            if step is not None and changes(step.effect, maps[-1], problem.ontology):
                steps.append(step)
                maps.append(apply_step(step, maps[-1], problem))
        if not formula_holds(problem.goal, maps[-1], problem.ontology):
            return None
        kept_steps = [steps[place] for place in find_useful_steps(steps, maps, problem)]
        steps = [structs.replace(step, id=f"step{number}") for number, step in enumerate(kept_steps, 1)]
        maps = [problem.map]
        for step in steps:
            maps.append(apply_step(step, maps[-1], problem))
        plan = Plan(tuple(steps), derive_links(steps, maps, problem))
        return plan if not validate(plan, problem) else None
    except FormulaError:  # the plan names an object that is no longer on the map
        return None


def _without_lapsed_condition(step: Step, map: Map, problem: Problem) -> Step:
    """The step, without a condition that does not hold any more: services stated it for another situation, and are asked again."""
    if step.condition is None or formula_holds(step.condition, map, problem.ontology):
        return step
    return structs.replace(step, condition=None, demanded_by=())


def _adapt_step(old: Step, map: Map, problem: Problem, available_services: Mapping[str, AvailableService]) -> Step | None:
    """The step as it is applicable on the map, or None. Variables that its inputs do not bind may be bound anew.

    A step that tells something is not kept: it may have told it."""
    if old.tells:
        return None
    offered = available_services.get(old.service_type)
    if offered is None or (old.provider is not None and old.provider not in offered.providers):
        return None
    involved = {name for term in old.inputs.values() for name in names(term)} | {old.provider}
    if not involved.isdisjoint(problem.excluded):
        return None
    service = offered.service_type
    if old.precondition is None or service.start_condition is None or formula_holds(old.precondition, map, problem.ontology):
        return old
    condition = substitute(parse(service.start_condition), old.bindings)
    support = supporting_literals(condition, map, problem.ontology)
    if support is None or not problem.excluded.isdisjoint(name for term in support[1].values() for name in names(term)):
        return None
    literals, row = support
    effect = substitute(parse(service.effect), {**row, **old.bindings})
    if variables(effect):
        return None
    return structs.replace(old, precondition=conjunction(*literals), effect=evaluate_effect(effect, map, problem.ontology))


def prefer_repaired(problem: Problem, short: Plan | NoPlan | None) -> Plan | NoPlan | None:
    """The rest of the previous plan, if services are committed to all of its steps but at most one: then no search is needed. Otherwise
    `short`, which was found without a search."""
    plan = repair_plan(problem) if problem.rest else None
    if plan is None or (isinstance(short, Plan) and len(short.steps) < len(plan.steps)):
        return short
    promised = [_step_key(step) for step in problem.rest if step.id in problem.promised]
    return plan if sum(_step_key(step) not in promised for step in plan.steps) <= 1 else short


def prefer_shorter(problem: Problem, result: Plan | NoPlan) -> Plan | NoPlan:
    """The rest of the previous plan, unless `result`, from a search, has fewer steps."""
    plan = repair_plan(problem) if problem.rest else None
    if plan is None or (isinstance(result, Plan) and len(result.steps) < len(plan.steps)):
        return result
    return plan


def _step_key(step: Step) -> object:
    """What identifies a step, apart from its id."""
    return step.service_type, step.inputs, step.provider

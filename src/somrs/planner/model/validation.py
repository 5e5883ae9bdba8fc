"""Validates a plan by executing its steps on the map."""

from __future__ import annotations

from somrs.entish.formula import substitute, variables
from somrs.entish.parse import parse
from somrs.ontology.effects import apply_effect, evaluate_effect
from somrs.ontology.map import Map
from somrs.ontology.truth import formula_holds
from somrs.planner.model.plan import Plan, Step
from somrs.planner.model.problem import Problem


def validate(plan: Plan, problem: Problem) -> list[str]:
    """The errors of the plan, found by executing its steps on the map in topological order; empty if the plan is valid."""
    wrong: list[str] = []
    map = problem.map
    service_types = {available.service_type.name: available.service_type for available in problem.services}
    for step in plan.topological():
        if step.service_type not in service_types:
            wrong.append(f"{step.id}: no device offers {step.service_type}")
            continue
        if step.precondition is not None and not formula_holds(step.precondition, map, problem.ontology):
            wrong.append(f"{step.id}: {step} needs {step.precondition}, which does not hold by then")
        promised = substitute(parse(service_types[step.service_type].effect), step.bindings)
        if not variables(promised) and step.effect != evaluate_effect(promised, map, problem.ontology):
            wrong.append(f"{step.id}: {step.effect} is not what {step} brings about")
        map = apply_step(step, map, problem)
    if not formula_holds(problem.goal, map, problem.ontology):
        wrong.append(f"after all steps {problem.goal} does not hold")
    return wrong


def apply_step(step: Step, map: Map, problem: Problem) -> Map:
    """The map after the step, as far as the plan knows or assumes it."""
    return apply_effect(step.outcome, map, problem.ontology) if step.outcome is not None else map

"""Diverse plans: further plans for a problem, which differ from the first in the service types that they use.

The paper: "For a given task, Planner returns abstract plans". A service type of a plan is taken away, and the rest is planned again, so
each further plan does without something that another one uses (compare Coman and Munoz-Avila 2011, "Generating diverse plans").
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from msgspec import structs

from somrs.entish import Attribute, Comparison, Not, Relation
from somrs.entish.formula import conjuncts
from somrs.entish.parse import parse
from somrs.ontology.services import ServiceKind, ServiceType
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import Problem

MOST_STEPS = 10
"""The number of steps from which no further plans are sought: the first was hard enough to find."""
MOST_TRIES = 6
"""The number of planning problems that are tried for further plans."""
MOST_LENGTH = 2
"""The ratio of its length to that of the first plan beyond which a further plan is a detour."""


def may_have_alternatives(problem: Problem, plan: Plan) -> bool:
    """Whether further plans are wanted, and a service type that the plan does not use changes what one of its own changes."""
    if problem.most_plans < 2 or problem.rest or not 0 < len(plan.steps) < MOST_STEPS:
        return False
    used = _types(plan)
    changed = {subject for service in _physical(problem) if service.name in used for subject in _changes(service)}
    return any(not changed.isdisjoint(_changes(service)) for service in _physical(problem) if service.name not in used)


def with_alternatives(problem: Problem, first: Plan, plan: Callable[[Problem], Plan | NoPlan]) -> Plan:
    """The plan with up to `problem.most_plans - 1` others, each of which uses another set of service types. `plan` solves a problem."""
    if not may_have_alternatives(problem, first):
        return first
    plans, tried = [first], {frozenset[str]()}
    agenda = [frozenset({name}) for name in sorted(_types(first))]
    while agenda and len(plans) < problem.most_plans and len(tried) <= MOST_TRIES:
        without = agenda.pop(0)
        if without in tried:
            continue
        tried.add(without)
        services = tuple(available for available in problem.services if available.service_type.name not in without)
        result = plan(structs.replace(problem, services=services, most_plans=1, explained=False))
        if not isinstance(result, Plan) or not result.steps or any(step.tells for step in result.steps):
            continue  # what has to be found out first cannot be quoted
        if len(result.steps) <= MOST_LENGTH * len(first.steps) and _types(result) not in [_types(other) for other in plans]:
            plans.append(structs.replace(result, alternatives=()))
        agenda += [without | {name} for name in sorted(_types(result))]
    return structs.replace(first, alternatives=tuple(plans[1:]))


def _types(plan: Plan) -> frozenset[str]:
    return frozenset(step.service_type for step in plan.steps)


def _physical(problem: Problem) -> Iterator[ServiceType]:
    for available in problem.services:
        if available.service_type.kind is ServiceKind.PHYSICAL:
            yield available.service_type


def _changes(service: ServiceType) -> frozenset[str]:
    """The relations and attribute paths in the effect of the service type."""
    subjects: set[str] = set()
    for part in conjuncts(parse(service.effect)):
        atom = part.atom if isinstance(part, Not) else part
        if isinstance(atom, Relation):
            subjects.add(atom.relation)
        elif isinstance(atom, Comparison):
            subjects.update("." + side.path for side in (atom.left, atom.right) if isinstance(side, Attribute))
    return frozenset(subjects)

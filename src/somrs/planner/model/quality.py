"""Quality of plans: cost and makespan."""

from __future__ import annotations

from collections.abc import Iterable

from somrs.ontology.services import PROVIDER
from somrs.planner.model.plan import Plan
from somrs.planner.model.problem import Problem
from somrs.planner.model.world import World, as_argument


def best(problem: Problem, plans: Iterable[Plan]) -> Plan:
    """The plan with the lowest cost, then the lowest makespan; with `problem.hurry` the makespan comes first. Of equals, the first."""

    def preference(plan: Plan) -> tuple[float, float]:
        costs, ends = cost(plan, problem), makespan(plan)
        return (ends, costs) if problem.hurry else (costs, ends)

    return min(plans, key=preference)


def cost(plan: Plan, problem: Problem) -> float:
    """The estimated cost of all steps in euros, before services quote prices for them."""
    world = World(problem)
    services = {available.service_type.name: available.service_type for available in problem.services}
    total = 0.0
    for step in plan.steps:
        binding = {name: as_argument(term) for name, term in step.inputs.items()}
        if step.provider is not None:
            binding[PROVIDER] = step.provider
        total += world.cost(services[step.service_type], binding)
    return total


def makespan(plan: Plan) -> int:
    """The makespan in steps, assuming that all steps take equally long, start as soon as their links allow, and a device that a step is
    bound to does one step at a time."""
    ends: dict[str, int] = {}
    free: dict[str, int] = {}
    for step in plan.topological():
        start = max((ends[predecessor] for predecessor in plan.predecessors(step.id)), default=0)
        if step.provider is not None:
            start = max(start, free.get(step.provider, 0))
            free[step.provider] = start + 1
        ends[step.id] = start + 1
    return max(ends.values(), default=0)

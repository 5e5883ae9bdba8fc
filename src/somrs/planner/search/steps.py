"""From the moves of a search to a validated abstract plan."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import structs

from somrs.entish import Formula, Term
from somrs.entish.formula import conjunction, substitute, variables
from somrs.ontology.effects import evaluate_effect
from somrs.ontology.objects import Map
from somrs.planner.grounding.grounding import Action
from somrs.planner.grounding.task import Move
from somrs.planner.model.causal_links import derive_links
from somrs.planner.model.plan import Plan, Step
from somrs.planner.model.problem import Problem
from somrs.planner.model.validation import apply_step, validate
from somrs.planner.model.world import as_term, rows


def build_plan(problem: Problem, moves: Sequence[Move]) -> Plan:
    """The plan of the moves, with the links between its steps. Raises AssertionError if it is not valid."""
    steps: list[Step] = []
    written: list[Formula] = []
    maps = [problem.map]
    for move in moves:
        step = _step(f"step{len(steps) + 1}", move.action, maps[-1], problem)
        written.append(step.effect)
        steps.append(structs.replace(step, effect=evaluate_effect(step.effect, maps[-1], problem.ontology)))
        maps.append(apply_step(steps[-1], maps[-1], problem))
    plan = Plan(tuple(steps), derive_links(steps, maps, problem, written))
    wrong = validate(plan, problem)
    if wrong:
        raise AssertionError("; ".join(wrong))
    return plan


def _step(id: str, action: Action, map: Map, problem: Problem) -> Step:
    """The step of an action; the variables that the action leaves open are bound on the map at its start."""
    operator = action.operator
    assert operator.service is not None, "the goal is no step"
    assert operator.effect is not None, "services have effects"
    binding: dict[str, Term] = {name: as_term(value) for name, value in action.binding.items()}
    precondition: Formula | None = None
    if operator.condition:
        condition = conjunction(*operator.condition)
        substitution = {name: binding[name] for name in variables(condition) if name in binding}
        row = next(rows(condition, substitution, map, problem.ontology), None)
        if row is None:
            raise AssertionError(f"{operator.service.name} was planned where {substitute(condition, substitution)} does not hold")
        binding.update(row)
        precondition = substitute(condition, binding)
    return Step(
        id=id,
        service_type=operator.service.name,
        inputs={parameter.name: binding[parameter.name] for parameter in operator.service.inputs},
        effect=substitute(operator.effect, binding),
        precondition=precondition,
        provider=action.provider,
    )

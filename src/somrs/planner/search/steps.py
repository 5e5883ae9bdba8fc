"""From the moves of a search to the steps of an abstract plan, which is validated."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import structs

from somrs.entish import Formula, Term
from somrs.entish.formula import conjunction, substitute, variables
from somrs.ontology.effects import evaluate_effect
from somrs.ontology.objects import Map
from somrs.planner.grounding.grounding import Action
from somrs.planner.grounding.task import Move
from somrs.planner.model.causal import linked
from somrs.planner.model.plan import Plan, Step
from somrs.planner.model.problem import Problem
from somrs.planner.model.validation import after, validate
from somrs.planner.model.world import as_term, rows


def stated(problem: Problem, moves: Sequence[Move]) -> Plan:
    """The plan that the moves are, in services, with the links between its steps."""
    steps: list[Step] = []
    written: list[Formula] = []
    maps = [problem.map]
    for move in moves:
        step = _step(f"step{len(steps) + 1}", move.action, maps[-1], problem)
        written.append(step.effect)
        steps.append(structs.replace(step, effect=evaluate_effect(step.effect, maps[-1], problem.ontology)))
        maps.append(after(steps[-1], maps[-1], problem))
    made = Plan(tuple(steps), linked(steps, maps, problem, written))
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

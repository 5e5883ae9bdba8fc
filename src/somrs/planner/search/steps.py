"""From the moves of a search to a validated abstract plan."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import structs

from somrs.entish import Attribute, Comparison, Formula, Name, Not, Relation, Term, Truth, Variable
from somrs.entish.formula import conjunction, names, substitute
from somrs.ontology.effects import evaluate_effect
from somrs.ontology.map import Map
from somrs.ontology.types import UNKNOWN
from somrs.planner.grounding.actions import Action
from somrs.planner.grounding.task import Move
from somrs.planner.model.causal_links import derive_links
from somrs.planner.model.plan import Link, Plan, Step
from somrs.planner.model.problem import Problem
from somrs.planner.model.supporting_literals import supporting_literals
from somrs.planner.model.validation import apply_step, validate
from somrs.planner.model.vocabulary import KNOWN
from somrs.planner.model.world import as_term


def build_plan(problem: Problem, moves: Sequence[Move]) -> Plan:
    """The plan of the moves, with the links between its steps. Raises AssertionError if it is not valid."""
    steps: list[Step] = []
    written: list[Formula | None] = []
    maps = [problem.map]
    for move in moves:
        if move.action.operator.is_choice:
            continue
        step = _step(f"step{len(steps) + 1}", move.action, maps[-1], problem)
        written.append(step.outcome)
        steps.append(_evaluated(step, maps[-1], problem))
        maps.append(apply_step(steps[-1], maps[-1], problem))
    plan = Plan(tuple(steps), _with_knowledge(steps, derive_links(steps, maps, problem, written)))
    wrong = validate(plan, problem)
    if wrong:
        raise AssertionError("; ".join(wrong))
    return plan


def _evaluated(step: Step, map: Map, problem: Problem) -> Step:
    if step.tells:
        return step
    return structs.replace(step, effect=evaluate_effect(step.effect, map, problem.ontology))


def _with_knowledge(steps: Sequence[Step], links: tuple[Link, ...]) -> tuple[Link, ...]:
    """The links, and those from the steps that find or make an object to the steps that use it."""
    finder: dict[str, str] = {}
    pairs = {(link.before, link.after) for link in links}
    added: list[Link] = []
    for step in steps:
        formulas = [part for part in (step.precondition, step.outcome) if part is not None]
        used = {name for part in (*step.inputs.values(), *formulas) for name in names(part)}
        for name in sorted(used & finder.keys()):
            if (finder[name], step.id) not in pairs:
                pairs.add((finder[name], step.id))
                added.append(Link(finder[name], step.id, str(Comparison(Attribute(Name(name), UNKNOWN), "=", Truth(False)))))
        finder.update(dict.fromkeys(step.finds, step.id))
    place = {step.id: number for number, step in enumerate(steps)}
    return tuple(sorted((*links, *added), key=lambda link: (place[link.after], link.is_protection, place[link.before]))) if added else links


def _assumed(action: Action) -> tuple[Formula | None, tuple[str, ...]]:
    """What the plan assumes after an action whose result is known only when it is done, and the objects that are known from then on."""
    parts: list[Formula] = []
    for predicate, arguments in action.add_effects:
        terms = tuple(map(as_term, arguments))
        if predicate.startswith("."):
            owner, value = terms
            assert isinstance(owner, Name), "attributes are those of objects"
            parts.append(Comparison(Attribute(owner, predicate[1:]), "=", value))
        elif predicate != KNOWN:
            parts.append(Relation(predicate, terms))  # type: ignore[arg-type]  # facts relate objects
    parts += [Not(Relation(predicate, tuple(map(as_term, arguments)))) for predicate, arguments in action.delete_effects]  # type: ignore[arg-type]
    finds = tuple(str(arguments[0]) for predicate, arguments in action.add_effects if predicate == KNOWN)
    return (conjunction(*parts) if parts else None), finds


def _step(id: str, action: Action, map: Map, problem: Problem) -> Step:
    """The step of an action; the variables that the action leaves open are bound on the map at its start."""
    operator = action.operator
    assert operator.service is not None, "the goal is no step"
    assert operator.effect is not None, "services have effects"
    binding: dict[str, Term] = {name: as_term(value) for name, value in action.binding.items()}
    precondition: Formula | None = None
    if operator.condition:
        condition = conjunction(*operator.condition)
        support = supporting_literals(condition, map, problem.ontology, binding)
        if support is None:
            raise AssertionError(f"{operator.service.name} was planned where {substitute(condition, binding)} does not hold")
        literals, binding = support
        precondition = conjunction(*literals)
    assumed, finds = _assumed(action) if operator.tells else (None, ())
    outputs = {output.name: Variable(output.name) for output in operator.service.outputs}
    return Step(
        id=id,
        service_type=operator.service.name,
        inputs={parameter.name: binding[parameter.name] for parameter in operator.service.inputs},
        effect=substitute(operator.effect, {**binding, **outputs}),
        precondition=precondition,
        provider=action.provider,
        kind=operator.service.kind,
        assumed=assumed,
        finds=finds,
    )

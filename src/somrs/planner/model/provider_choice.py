"""Alternative providers for the steps of a plan: a group of steps needs one device, but not always the device that the search chose.

The search binds every service whose formulas use `?Provider` to the first device that fits. This module finds the other devices that fit
as well. Arrangement then chooses among them by their terms, one device for all steps of a group.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeVar

from msgspec import structs

from somrs.entish import Attribute, Call, Comparison, Formula, Name, Not, Relation, Term, Variable
from somrs.entish.formula import Arithmetic, Literal, conjunction, conjuncts, names, terms
from somrs.entish.parse import parse
from somrs.ontology.services import PROVIDER, ServiceType
from somrs.ontology.truth import formula_holds
from somrs.ontology.types import Ontology
from somrs.planner.model.causal_links import touches
from somrs.planner.model.plan import NoPlan, Plan, Step
from somrs.planner.model.problem import Problem

Result = TypeVar("Result", bound=Plan | NoPlan | None)


def generalize_providers(problem: Problem, result: Result) -> Result | Plan:
    """The result; if it is a plan, with `device_group` and `alternative_providers` for the steps that other devices could execute."""
    return _generalize_plan(result, problem) if isinstance(result, Plan) else result


def _generalize_plan(plan: Plan, problem: Problem) -> Plan:
    offers = {available.service_type.name: available for available in problem.services}
    alternatives: dict[str, tuple[str, tuple[str, ...]]] = {}
    for number, group in enumerate(_groups(plan), 1):
        provider = group[0].provider
        assert provider is not None, "a group is bound to a device"
        capable_providers = (
            set[str].intersection(*(set(offers[step.service_type].providers) for step in group)) - problem.excluded - {provider}
        )
        types = [offers[step.service_type].service_type for step in group]
        if capable_providers and not _is_special(provider, group, types, problem):
            device_conditions = _find_device_conditions(provider, group, plan, problem.ontology)
            if device_conditions is not None:
                alternative_providers = [
                    candidate
                    for candidate in sorted(capable_providers)
                    if all(
                        formula_holds(_replace_provider(part, provider, candidate), problem.map, problem.ontology)
                        for part in device_conditions
                    )
                ]
                alternatives.update({step.id: (f"device{number}", tuple(alternative_providers)) for step in group if alternative_providers})
    if not alternatives:
        return plan
    steps = (
        structs.replace(step, device_group=alternatives[step.id][0], alternative_providers=alternatives[step.id][1])
        if step.id in alternatives
        else step
        for step in plan.steps
    )
    return Plan(tuple(steps), plan.links)


def assign_provider(step: Step, provider: str) -> Step:
    """The step, executed by the given device, which is one of its `alternative_providers`."""
    if step.provider is None:
        return step
    precondition = _replace_provider(step.precondition, step.provider, provider) if step.precondition is not None else None
    return structs.replace(
        step,
        precondition=precondition,
        effect=_replace_provider(step.effect, step.provider, provider),
        provider=provider,
        alternative_providers=(),
    )


def _groups(plan: Plan) -> Iterator[list[Step]]:
    """Groups of steps of one device, joined by links whose fact is about the device."""
    group_of = {step.id: [step] for step in plan.steps if step.provider is not None}
    for link in plan.links:
        producer, consumer = plan.step(link.before), plan.step(link.after)
        if producer.provider is not None and producer.provider == consumer.provider and producer.provider in names(parse(link.fact)):
            first, second = group_of[producer.id], group_of[consumer.id]
            if first is not second:
                first += second
                group_of.update({step.id: first for step in second})
    seen_groups: set[int] = set()
    for group in group_of.values():
        if id(group) not in seen_groups:
            seen_groups.add(id(group))
            yield group


def _is_special(provider: str, group: Sequence[Step], types: Sequence[ServiceType], problem: Problem) -> bool:
    """Whether the group needs this very device: the goal or an input names it, an effect changes it, or an effect reads its attributes."""
    if provider in names(problem.goal) or any(provider in names(term) for step in group for term in step.inputs.values()):
        return True
    if any(_changes(part, provider, problem.ontology) for step in group for part in conjuncts(step.effect)):
        return True
    values = (term for type in types for term in terms(parse(type.effect)) if isinstance(term, Attribute | Call))
    return any(PROVIDER in _variable_names(term) for term in values)


def _variable_names(term: Term) -> Iterator[str]:
    return (inner.name for inner in terms(term) if isinstance(inner, Variable))


def _changes(effect: Formula, name: str, ontology: Ontology) -> bool:
    """Whether the effect changes a fact or an attribute of the object."""
    match effect.atom if isinstance(effect, Not) else effect:
        case Relation(relation, arguments):
            relation_type = ontology.relations.get(relation)
            return Name(name) in (arguments if relation_type is not None and relation_type.symmetric else arguments[:1])
        case _ as comparison:
            return name in names(comparison)


def _find_device_conditions(provider: str, group: Sequence[Step], plan: Plan, ontology: Ontology) -> list[Literal] | None:
    """The conditions on the device that the group needs and does not achieve itself; None if a step of the plan may change one of them."""
    ids = {step.id for step in group}
    conditions: list[Literal] = []
    for step in group:
        achieved_facts = {link.fact for link in plan.links_to(step.id) if link.before in ids and not link.is_protection}
        for part in conjuncts(step.precondition) if step.precondition is not None else ():
            if provider not in names(part) or str(part) in achieved_facts:
                continue
            general_condition = _replace_name(part, provider, Variable(PROVIDER))
            if any(touches(effect, general_condition, ontology) for other_step in plan.steps for effect in conjuncts(other_step.effect)):
                return None
            conditions.append(part)  # type: ignore[arg-type]  # conjuncts of a conjunction of literals
    return conditions


def _replace_provider(formula: Formula, provider: str, replacement: str) -> Formula:
    return conjunction(*(_replace_name(part, provider, Name(replacement)) for part in conjuncts(formula)))


def _replace_name(literal: Formula, name: str, replacement: Name | Variable) -> Literal:
    """The literal with the name replaced by another term."""

    def term(old: Term) -> Term:
        match old:
            case Name() if old.name == name:
                return replacement
            case Attribute(owner, path):
                return Attribute(term(owner), path)  # type: ignore[arg-type]  # still a name or variable
            case Call(function, arguments):
                return Call(function, tuple(map(term, arguments)))
            case Arithmetic(left_term, operator, right_term):
                return Arithmetic(term(left_term), operator, term(right_term))
            case _:
                return old

    match literal:
        case Not(atom):
            return Not(_replace_name(atom, name, replacement))  # type: ignore[arg-type]  # still an atom
        case Relation(relation, arguments):
            return Relation(relation, tuple(map(term, arguments)))  # type: ignore[arg-type]
        case Comparison(left_term, operator, right_term):
            return Comparison(term(left_term), operator, term(right_term))
    raise AssertionError(f"{literal} is no literal")

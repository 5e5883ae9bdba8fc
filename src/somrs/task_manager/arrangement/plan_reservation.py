"""The objects that a plan changes, and those that it relies on: a task reserves them."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator

from somrs.entish import Attribute, Call, Comparison, Formula, Name, Not, Relation, Term
from somrs.entish.formula import alternatives, literals, terms
from somrs.kernel.reservations import Reservation
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact
from somrs.ontology.qualified_names import home_of
from somrs.ontology.services import ServiceKind
from somrs.ontology.types import Ontology
from somrs.planner.model.plan import Step


def plan_reservation(steps: Iterable[Step], goal: Formula, ontology: Ontology) -> Reservation:
    """The objects that a plan changes and relies on. A service that only tells something changes nothing. A goal with OR adds none: it is
    not known which part will hold."""
    changes: set[str] = set()
    relies: set[str] = set()
    for step in steps:
        if step.kind is not ServiceKind.PHYSICAL:
            relies.update(_formula_objects(step.effect, ontology))
        for literal in literals(step.effect) if step.kind is ServiceKind.PHYSICAL else ():
            atom = literal.atom if isinstance(literal, Not) else literal
            if isinstance(atom, Comparison):
                target, source = (atom.left, atom.right) if isinstance(atom.left, Attribute) else (atom.right, atom.left)
                changes.update(_term_objects(target))
                relies.update(_term_objects(source))
            else:
                changes.update(_subjects(atom, ontology))
        if step.precondition is not None:
            relies.update(_formula_objects(step.precondition, ontology))
    if len([*alternatives(goal)]) == 1:
        relies.update(_formula_objects(goal, ontology))
    return Reservation(changes=frozenset(changes), relies_on=frozenset(relies - changes))


def facts_of_several_maps(steps: Iterable[Step], plan_changes: Container[str], map: Map, ontology: Ontology) -> tuple[Fact, ...]:
    """The facts of a plan's effects that relate a neighbour's object to things of another map. Devices, and other things that the plan
    changes (`plan_changes`), are left out: who sees them may change with their places."""
    facts: dict[Fact, None] = {}
    for step in steps:
        for literal in literals(step.effect) if step.kind is ServiceKind.PHYSICAL else ():
            if isinstance(literal, Relation) and all(isinstance(argument, Name) for argument in literal.arguments):
                subject, *others = (str(argument) for argument in literal.arguments)
                others = [name for name in others if home_of(name) != home_of(subject)]
                fixed = [name for name in others if name in map.objects and name not in plan_changes]
                if home_of(subject) and fixed and not any(ontology.is_device(map.objects[name].type) for name in fixed):
                    facts[Fact(literal.relation, (subject, *fixed))] = None
    return tuple(facts)


def _formula_objects(formula: Formula, ontology: Ontology) -> Iterator[str]:
    for literal in literals(formula):
        atom = literal.atom if isinstance(literal, Not) else literal
        if isinstance(atom, Comparison):
            yield from _term_objects(atom.left)
            yield from _term_objects(atom.right)
        else:
            yield from _subjects(atom, ontology)


def _subjects(atom: Relation, ontology: Ontology) -> Iterator[str]:
    """The objects that a fact is about: its first argument, or all arguments of a symmetric relation."""
    relation = ontology.relations.get(atom.relation)
    subjects = atom.arguments if relation is not None and relation.symmetric else atom.arguments[:1]
    yield from (argument.name for argument in subjects if isinstance(argument, Name))


def _term_objects(term: Term) -> Iterator[str]:
    """The objects whose attributes a term uses."""
    for inner in terms(term):
        match inner:
            case Attribute(Name(name)):
                yield name
            case Call(_, arguments):
                yield from (argument.name for argument in arguments if isinstance(argument, Name))

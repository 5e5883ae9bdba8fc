"""Which parts of a goal no service could ever bring about, by the effects of services alone: no plan is searched for."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator

from msgspec import Struct

from somrs.entish.formula import And, Exists, ForAll, Formula, Literal, Name, Not, Or, Relation
from somrs.entish.parse import parse
from somrs.ontology.matching import can_achieve, unifiers
from somrs.ontology.objects import Map
from somrs.ontology.services import ServiceKind, ServiceType
from somrs.ontology.truth import bindings
from somrs.ontology.types import Ontology


class Unachievable(Struct, frozen=True):
    """A part of a goal that does not hold and that no service brings about, and why. `reason` is empty if no service has such an effect
    on any object."""

    literal: Literal
    reason: str


def unachievable_parts(goal: Formula, services: Collection[ServiceType], ontology: Ontology, map: Map) -> Iterator[Unachievable]:
    """The parts without which the goal cannot hold, and that no service brings about; none for an OR with an achievable alternative."""
    match goal:
        case And(parts):
            for part in parts:
                yield from unachievable_parts(part, services, ontology, map)
        case Or(parts):
            of_each = [[*unachievable_parts(part, services, ontology, map)] for part in parts]
            if all(of_each):
                yield from of_each[0]
        case ForAll(_, body) | Exists(_, body):
            yield from unachievable_parts(body, services, ontology, map)
        case literal:
            if next(bindings(literal, map, ontology), None) is None and not is_achievable(literal, services, ontology, map):
                fitting = (reason for service in services for reason in misfits(service, literal, ontology, map))
                yield Unachievable(literal, next(fitting, ""))


def is_achievable(literal: Literal, services: Iterable[ServiceType], ontology: Ontology, map: Map) -> bool:
    """Whether a service could bring the literal about. A service that recognises relations does not bring them about."""
    is_relation = isinstance(literal.atom if isinstance(literal, Not) else literal, Relation)
    able = (service for service in services if not (is_relation and service.kind is ServiceKind.COGNITIVE))
    return any(can_achieve(service, literal, ontology, map) for service in able)


def misfits(service: ServiceType, literal: Literal, ontology: Ontology, map: Map) -> Iterator[str]:
    """Texts for the inputs whose type does not admit the literal's objects, where the service brings such things about for others."""
    if service.kind is not ServiceKind.PHYSICAL:
        return
    types = {parameter.name: parameter.type for parameter in service.inputs}
    for unifier in unifiers(parse(service.effect), literal, ontology, types):
        objects = {name: map.objects.get(term.name) for name, term in unifier.items() if isinstance(term, Name)}
        for name, object in objects.items():
            if object is not None and name in types and not ontology.is_subtype(object.type, types[name]):
                yield f"{service.name} takes only a {types[name]} as its {name}, and {object.name} is a {object.type}"

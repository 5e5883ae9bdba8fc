"""The optimistic reading of a problem: what the planner assumes that services will find out or make (paper, "Services": the three kinds).

A cognitive service changes nothing: it finds out what is not known. A software service changes nothing either: it computes outputs. What
they will say is known only when they have said it. A plan that needs it therefore assumes a favourable answer, is executed up to there,
and is completed when the answer is known (Bonet and Geffner 2011, "Planning under partial observability by classical replanning").
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property

from msgspec import Struct

from somrs.entish import Attribute, Comparison, Formula, Name, Relation, Truth, Variable
from somrs.entish.formula import conjuncts, substitute, variables
from somrs.entish.parse import parse
from somrs.ontology.services import ServiceKind, ServiceType
from somrs.ontology.types import UNKNOWN, Ontology


class Reading(Struct, frozen=True, kw_only=True, dict=True):
    """What the planner assumes beyond the map.

    `unknown` are the objects that no step can use before a service has found or made them, with their types: those whose place and state
    are not known, and the outputs of services. `outputs` names the objects that stand for an output, by service type and output: one for
    each use of the service in a plan. `places` names the object that stands for the place of an object that is found, by type. With
    `favourable`, an object can be found anywhere; otherwise only at such a place, so that no plan relies on luck where it need not.
    """

    unknown: tuple[tuple[str, str], ...] = ()
    outputs: tuple[tuple[tuple[str, str], tuple[str, ...]], ...] = ()
    places: tuple[tuple[str, str], ...] = ()
    favourable: bool = False

    @cached_property
    def unknown_objects(self) -> Mapping[str, str]:
        """The types of the unknown objects, by name."""
        return dict(self.unknown)

    @cached_property
    def fresh(self) -> frozenset[str]:
        """The objects that stand for outputs."""
        return frozenset(name for _, names in self.outputs for name in names)

    def predecessor(self, fresh: str) -> str | None:
        """The object that stands for the output in the use of the service before this one; None for the first."""
        names = next(names for _, names in self.outputs if fresh in names)
        number = names.index(fresh)
        return names[number - 1] if number else None

    def outcomes(self, service: ServiceType, effect: Formula, ontology: Ontology) -> Iterator[tuple[Formula, ...]]:
        """The alternatives of what the planner may assume after the service, each as parts of an effect. `effect` is that of the service,
        with typed variables."""
        made = {output: names for (service_type, output), names in self.outputs if service_type == service.name}
        for number in range(max(map(len, made.values()), default=1)):
            with_outputs = substitute(effect, {output: Name(names[number]) for output, names in made.items()})
            yield from self._outcomes(service, conjuncts(with_outputs), ontology)

    def _outcomes(self, service: ServiceType, parts: tuple[Formula, ...], ontology: Ontology) -> Iterator[tuple[Formula, ...]]:
        if service.kind is not ServiceKind.PHYSICAL:
            parts = tuple(part for part in parts if isinstance(part, Relation | Comparison))
        looked_for = [owner for part in parts if service.kind is ServiceKind.COGNITIVE and (owner := looked_for_in(part)) is not None]
        if not looked_for:
            yield parts
        for owner in looked_for:
            yield from ((*parts, place) for place in self._places_of(owner, ontology))

    def _places_of(self, owner: Name | Variable, ontology: Ontology) -> Iterator[Relation]:
        """Where an object that was looked for can be."""
        places = dict(self.places)
        for relation in ontology.relations.values():
            if relation.excludes is None:
                continue
            rest = tuple(
                Variable(f"where {relation.name} {number}", type) if self.favourable else Name(places[type])
                for number, type in enumerate(relation.joins[1:])
            )
            yield Relation(relation.name, (owner, *rest))


def tells(service: ServiceType) -> bool:
    """Whether the planner cannot know the result of the service: it finds out or computes something, or chooses what it makes."""
    return service.kind is not ServiceKind.PHYSICAL or bool(outputs_in_effect(service))


def outputs_in_effect(service: ServiceType) -> list[str]:
    """The outputs that the effect speaks of."""
    in_effect = variables(parse(service.effect))
    inputs = {parameter.name for parameter in service.inputs}
    return [output.name for output in service.outputs if output.name in in_effect and output.name not in inputs]


def looked_for_in(part: Formula) -> Name | Variable | None:
    """The object whose place and state are found out, if the part says so: `?Object.Unknown = FALSE`."""
    match part:
        case Comparison(Attribute(owner, path), "=", Truth(False)) if path == UNKNOWN:
            return owner
    return None


def found_in(parts: Iterable[Formula], ontology: Ontology) -> Iterator[Name | Variable]:
    """The objects whose place is known after these parts of what a service tells."""
    for part in parts:
        if (owner := looked_for_in(part)) is not None:
            yield owner
        if isinstance(part, Relation) and (relation := ontology.relations.get(part.relation)) is not None and relation.excludes is not None:
            yield part.arguments[0]

"""An example of a goal that fits the site: a thing of the map, to be where other things are."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from somrs.entish.formula import Relation, Variable
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact
from somrs.ontology.qualified_names import home_of
from somrs.ontology.services import ServiceKind, ServiceType
from somrs.ontology.types import Ontology


def example_goal(service_types: Iterable[str], ontology: Ontology, map: Map) -> str | None:
    """A goal that one of the services can achieve, as far as types say; None if none of them brings an object of the map to another place.

    The object stands in the relation of the service's effect to something now, so that it can be moved. The place is one at which another
    object is or, failing that, one of the same type as the object's place.
    """
    services = [service for name in sorted(set(service_types)) if (service := ontology.services.get(name)) is not None]
    goals = (str(goal) for service in services if service.kind is ServiceKind.PHYSICAL for goal in _goals(service, ontology, map))
    return next(goals, None)


def is_achieved(goal: str, map: Map) -> bool:
    """Whether a goal of `example_goal` holds, or one of its objects is not on the map any more."""
    thing, relation, place = goal.split(" ")
    return thing not in map.objects or place not in map.objects or map.has_fact(relation, (thing, place))


def _goals(service: ServiceType, ontology: Ontology, map: Map) -> Iterator[Fact]:
    types = {parameter.name: parameter.type for parameter in service.inputs}
    try:
        effect = parse(service.effect)
    except FormulaError:
        return
    match effect:
        case Relation(relation, (Variable(thing_name), Variable(place_name))) if thing_name in types and place_name in types:
            thing_type, place_type = types[thing_name], types[place_name]
        case _:
            return

    def fits(name: str, type_name: str) -> bool:
        return name in map.objects and ontology.is_subtype(map.objects[name].type, type_name)

    # A neighbour's things may be out of reach.
    facts = [
        fact.arguments for fact in map.facts(relation) if len(fact.arguments) == 2 and not any(home_of(name) for name in fact.arguments)
    ]
    used_places = dict.fromkeys(place for _, place in facts)
    for thing, current_place in facts:
        if fits(thing, thing_type) and current_place in map.objects:
            for place in (*used_places, *map.of_type(map.objects[current_place].type)):
                if place not in (thing, current_place) and not home_of(place) and fits(place, place_type):
                    yield Fact(relation, (thing, place))

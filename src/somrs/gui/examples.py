"""Examples of formulas for empty fields. They name objects of the site's map, so that a user can enter them as they are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from msgspec import Struct

from somrs.ontology.completion import fitting_objects, service_effects
from somrs.ontology.cursor import Slot
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact
from somrs.ontology.services import PROVIDER
from somrs.ontology.types import ROOT, Ontology

MAX_THINGS = 50
"""Objects that are tried for an example; one of the first usually has a place."""


class Examples(Struct, frozen=True, kw_only=True):
    """Examples about one object. Where the map has no suitable objects, they show the form of a formula."""

    goal: str = "Object relation Place"
    """The object in another place, to which a service can bring it."""
    condition: str = "Object relation Place"
    """The object in its present place."""
    query: str = "?Thing relation Place"
    """All objects in that place."""


def examples(map: Map, ontology: Ontology, thing: str | None = None) -> Examples:
    """Examples about a movable object, or about `thing`."""
    if thing is not None and thing not in map.objects:
        return _about(thing)
    placements = [*_placements(map, ontology, thing)]
    if not placements:
        return _about(thing) if thing is not None else Examples()
    goal, present_fact = next((placement for placement in placements if placement[1] is not None), placements[0])
    if present_fact is None:
        return Examples(goal=str(goal))
    return Examples(goal=str(goal), condition=str(present_fact), query=f"?Thing {present_fact.relation} {present_fact.arguments[1]}")


def with_variables(example: str, types: Mapping[str, str], map: Map, ontology: Ontology) -> str:
    """The example with a variable in place of its first object, if one of these types admits the object."""
    thing, _, rest = example.partition(" ")
    object = map.objects.get(thing)
    if object is None:
        return example
    inputs = {name: type_name for name, type_name in types.items() if name != PROVIDER}  # handlers concern what the device handled
    variable = next((name for name, type_name in inputs.items() if ontology.is_subtype(object.type, type_name)), None)
    return f"?{variable} {rest}" if variable is not None else example


def _about(thing: str) -> Examples:
    neutral = f"{thing} relation Place"
    return Examples(goal=neutral, condition=neutral)


def _placements(map: Map, ontology: Ontology, thing: str | None) -> Iterator[tuple[Fact, Fact | None]]:
    """Facts that services can bring about, each with the present fact of the same relation, if there is one."""
    for name, types in service_effects(ontology).items():
        relation = ontology.relations.get(name)
        if relation is None or len(relation.joins) != 2 or len(types) != 2 or types[0] == ROOT:
            continue  # an attribute, or a relation of the device itself
        movable = [object.name for object in fitting_objects(ontology, map, Slot(relation=name, place=0, type=types[0]))]
        places = [
            object.name
            for object in fitting_objects(ontology, map, Slot(relation=name, place=1, type=relation.joins[1]))
            if ontology.is_subtype(object.type, types[1])
        ]
        for candidate in [thing] if thing in movable else movable[:MAX_THINGS] if thing is None else []:
            present = next(iter(map.facts_with(name, 0, candidate)), None)
            taken = {candidate, *(present or ())}
            place = next((place for place in places if place not in taken), None)
            if place is not None:
                yield Fact(name, (candidate, place)), Fact(name, present) if present is not None else None

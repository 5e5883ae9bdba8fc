"""What those can choose from who do not write formulas: things, what can be said of one, and what putting one somewhere means."""

from __future__ import annotations

import msgspec

from somrs.entish.formula import Name, Relation
from somrs.ontology.completion import fitting_objects, service_effects, units_of
from somrs.ontology.cursor import Slot
from somrs.ontology.objects import Map, Object
from somrs.ontology.truth import value_of
from somrs.ontology.types import ABSTRACT, PART_OF, ROOT, Kind, Ontology, Value

SYMBOLS = (
    ("Person", "person"),
    ("Camera", "videocam"),
    ("StationaryManipulator", "precision_manufacturing"),
    ("Lift", "elevator"),
    ("Device", "smart_toy"),
    ("Graspable", "inventory_2"),
    ("Charger", "ev_station"),
    ("Place", "place"),
    ("Support", "table_restaurant"),
    ("Chair", "chair"),
    ("Furniture", "chair_alt"),
    ("Passage", "door_front"),
    ("BuildingElement", "view_quilt"),
    ("Space", "meeting_room"),
    ("Storey", "layers"),
    ("Building", "apartment"),
    (ABSTRACT, "domain"),
)
"""The Material icon of the first type that an object is of."""


class Thing(msgspec.Struct, frozen=True, kw_only=True):
    """An object to choose. `symbol`: a Material icon; `whole`: what it is a part of, or stands on."""

    name: str
    type: str
    symbol: str
    label: str = ""
    where: str = ""


class Things(msgspec.Struct, frozen=True, kw_only=True):
    """The likeliest first; `more`: there are others."""

    things: tuple[Thing, ...]
    more: bool = False


class SayableRelation(msgspec.Struct, frozen=True, kw_only=True):
    """`joins`: the type of what it joins the object with; `wished`: there are services that bring it about."""

    name: str
    joins: str
    wished: bool
    doc: str = ""


class SayableAttribute(msgspec.Struct, frozen=True, kw_only=True):
    """`units`: in which its values can be written, its own first; `now`: the value that the object has."""

    path: str
    kind: Kind
    wished: bool
    units: tuple[str, ...] = ()
    values: tuple[str, ...] = ()
    now: Value | None = None
    doc: str = ""


class Sayable(msgspec.Struct, frozen=True, kw_only=True):
    """What can be said of an object; what services bring about comes first."""

    thing: Thing
    relations: tuple[SayableRelation, ...]
    attributes: tuple[SayableAttribute, ...]


class Placings(msgspec.Struct, frozen=True, kw_only=True):
    """Formulas that say of a thing that it is at a target, the likeliest first: none, when it cannot be."""

    formulas: tuple[str, ...]


def thing(object: Object, ontology: Ontology, map: Map) -> Thing:
    symbol = next((icon for type_name, icon in SYMBOLS if ontology.is_subtype(object.type, type_name)), "category")
    label = object.values.get("Label")
    around = (next(iter(map.facts_with(relation, 0, object.name)), None) for relation in ("isOn", "isIn", "isHeldBy", "isAt", PART_OF))
    where = next((fact[1] for fact in around if fact is not None), "")
    return Thing(name=object.name, type=object.type, symbol=symbol, label=label if isinstance(label, str) else "", where=where)


def things(ontology: Ontology, map: Map, *, typed: str, type_name: str, relation: str | None, place: int, limit: int) -> Things:
    found = fitting_objects(ontology, map, Slot(relation=relation, place=place, type=type_name), typed)
    return Things(things=tuple(thing(one, ontology, map) for one in found[:limit]), more=len(found) > limit)


def sayable(object: Object, ontology: Ontology, map: Map) -> Sayable:
    wished = service_effects(ontology)
    relations = [
        SayableRelation(name=one.name, joins=one.joins[1], wished=one.name in wished, doc=one.doc)
        for one in ontology.relations.values()
        if len(one.joins) == 2 and ontology.is_subtype(object.type, one.joins[0])
    ]
    attributes = [
        SayableAttribute(
            path=path,
            kind=one.kind,
            wished=path in wished,
            units=units_of(one) if one.kind is Kind.NUMBER else (),
            values=one.values,
            now=value_of(object.name, path, map, ontology),
            doc=one.doc,
        )
        for path, one in ontology.attributes_of(object.type).items()
        if one.kind is not Kind.COMPLEX
    ]
    return Sayable(
        thing=thing(object, ontology, map),
        relations=tuple(sorted(relations, key=lambda one: not one.wished)),
        attributes=tuple(sorted(attributes, key=lambda one: not one.wished)),
    )


def placings(object: Object, target: Object, ontology: Ontology) -> Placings:
    """By the relations that say where something is: those of which it is in one at a time."""
    wished = service_effects(ontology)
    found = [
        one
        for one in ontology.relations.values()
        if len(one.joins) == 2
        and (one.excludes is not None or one.functional)
        and one.name != PART_OF
        and ontology.is_subtype(object.type, one.joins[0])
        and ontology.is_subtype(target.type, one.joins[1])
    ]
    # A robot is at a place rather than on it: what is said of some targets only means more than what is said of all.
    found.sort(key=lambda one: (one.joins[1] == ROOT, one.name not in wished))
    return Placings(formulas=tuple(str(Relation(one.name, (Name(object.name), Name(target.name)))) for one in found))

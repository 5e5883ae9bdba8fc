"""Choices for people who build a goal without writing a formula: objects, their relations and attributes, and locations."""

from __future__ import annotations

import msgspec

from somrs.entish.formula import Name, Relation
from somrs.ontology.completion import fitting_objects, service_effects, units_of
from somrs.ontology.cursor import Slot
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
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
"""Types and their Material icons. The first type that an object belongs to determines its icon."""


class Thing(msgspec.Struct, frozen=True, kw_only=True):
    """An object to choose. `symbol`: a Material icon; `location` (JSON: `where`): what it is on, in, held by, at or part of."""

    name: str
    type: str
    symbol: str
    label: str = ""
    location: str = msgspec.field(default="", name="where")


class Things(msgspec.Struct, frozen=True, kw_only=True):
    """Objects to choose from, the likeliest first. `is_truncated` (JSON: `more`): there are others."""

    things: tuple[Thing, ...]
    is_truncated: bool = msgspec.field(default=False, name="more")


class SayableRelation(msgspec.Struct, frozen=True, kw_only=True):
    """A relation that an object can be in. `joins`: the type of the other object; `achievable` (JSON `wished`): services can achieve it."""

    name: str
    joins: str
    achievable: bool = msgspec.field(name="wished")
    doc: str = ""


class SayableAttribute(msgspec.Struct, frozen=True, kw_only=True):
    """An attribute that an object can have. `achievable` (JSON: `wished`): services can change it; `units`: the units in which a value can
    be written, the attribute's own first; `now`: the current value."""

    path: str
    kind: Kind
    achievable: bool = msgspec.field(name="wished")
    units: tuple[str, ...] = ()
    values: tuple[str, ...] = ()
    now: Value | None = None
    doc: str = ""


class Sayable(msgspec.Struct, frozen=True, kw_only=True):
    """The relations and attributes of an object; those that services can change come first."""

    thing: Thing
    relations: tuple[SayableRelation, ...]
    attributes: tuple[SayableAttribute, ...]


class Placings(msgspec.Struct, frozen=True, kw_only=True):
    """Formulas that locate an object at a target, the likeliest first; empty if no relation can join them."""

    formulas: tuple[str, ...]


def _thing(object: Object, ontology: Ontology, map: Map) -> Thing:
    symbol = next((icon for type_name, icon in SYMBOLS if ontology.is_subtype(object.type, type_name)), "category")
    label = object.values.get("Label")
    location_facts = (
        next(iter(map.facts_with(relation, 0, object.name)), None) for relation in ("isOn", "isIn", "isHeldBy", "isAt", PART_OF)
    )
    location = next((fact[1] for fact in location_facts if fact is not None), "")
    return Thing(name=object.name, type=object.type, symbol=symbol, label=label if isinstance(label, str) else "", location=location)


def things(ontology: Ontology, map: Map, *, typed: str, type_name: str, relation: str | None, place: int, limit: int) -> Things:
    candidates = fitting_objects(ontology, map, Slot(relation=relation, place=place, type=type_name), typed)
    return Things(things=tuple(_thing(candidate, ontology, map) for candidate in candidates[:limit]), is_truncated=len(candidates) > limit)


def sayable(object: Object, ontology: Ontology, map: Map) -> Sayable:
    achievable_names = service_effects(ontology)
    relations = [
        SayableRelation(name=relation.name, joins=relation.joins[1], achievable=relation.name in achievable_names, doc=relation.doc)
        for relation in ontology.relations.values()
        if len(relation.joins) == 2 and ontology.is_subtype(object.type, relation.joins[0])
    ]
    attributes = [
        SayableAttribute(
            path=path,
            kind=attribute.kind,
            achievable=path in achievable_names,
            units=units_of(attribute) if attribute.kind is Kind.NUMBER else (),
            values=attribute.values,
            now=value_of(object.name, path, map, ontology),
            doc=attribute.doc,
        )
        for path, attribute in ontology.attributes_of(object.type).items()
        if attribute.kind is not Kind.COMPLEX
    ]
    return Sayable(
        thing=_thing(object, ontology, map),
        relations=tuple(sorted(relations, key=lambda relation: not relation.achievable)),
        attributes=tuple(sorted(attributes, key=lambda attribute: not attribute.achievable)),
    )


def placings(object: Object, target: Object, ontology: Ontology) -> Placings:
    """The formulas that locate an object at a target.

    A relation locates an object if the object can be in it with one target at a time: it is functional or excludes others.
    """
    achievable_names = service_effects(ontology)
    relations = [
        relation
        for relation in ontology.relations.values()
        if len(relation.joins) == 2
        and (relation.excludes is not None or relation.functional)
        and relation.name != PART_OF
        and ontology.is_subtype(object.type, relation.joins[0])
        and ontology.is_subtype(target.type, relation.joins[1])
    ]
    # A relation that accepts only some targets is more specific than one that accepts every object: a robot is at a place, not on it.
    relations.sort(key=lambda relation: (relation.joins[1] == ROOT, relation.name not in achievable_names))
    return Placings(formulas=tuple(str(Relation(relation.name, (Name(object.name), Name(target.name)))) for relation in relations))

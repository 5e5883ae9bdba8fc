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
    location: str = msgspec.field(default="", name="where")


class Things(msgspec.Struct, frozen=True, kw_only=True):
    """The likeliest first; `is_truncated`: there are others."""

    things: tuple[Thing, ...]
    is_truncated: bool = msgspec.field(default=False, name="more")


class SayableRelation(msgspec.Struct, frozen=True, kw_only=True):
    """`joins`: the type of what it joins the object with; `achievable`: there are services that bring it about."""

    name: str
    joins: str
    achievable: bool = msgspec.field(name="wished")
    doc: str = ""


class SayableAttribute(msgspec.Struct, frozen=True, kw_only=True):
    """`units`: in which its values can be written, its own first; `now`: the value that the object has."""

    path: str
    kind: Kind
    achievable: bool = msgspec.field(name="wished")
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
    location_facts = (
        next(iter(map.facts_with(relation, 0, object.name)), None) for relation in ("isOn", "isIn", "isHeldBy", "isAt", PART_OF)
    )
    location = next((fact[1] for fact in location_facts if fact is not None), "")
    return Thing(name=object.name, type=object.type, symbol=symbol, label=label if isinstance(label, str) else "", location=location)


def things(ontology: Ontology, map: Map, *, typed: str, type_name: str, relation: str | None, place: int, limit: int) -> Things:
    candidates = fitting_objects(ontology, map, Slot(relation=relation, place=place, type=type_name), typed)
    return Things(things=tuple(thing(candidate, ontology, map) for candidate in candidates[:limit]), is_truncated=len(candidates) > limit)


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
        thing=thing(object, ontology, map),
        relations=tuple(sorted(relations, key=lambda relation: not relation.achievable)),
        attributes=tuple(sorted(attributes, key=lambda attribute: not attribute.achievable)),
    )


def placings(object: Object, target: Object, ontology: Ontology) -> Placings:
    """By the relations that say where something is: those of which it is in one at a time."""
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
    # A robot is at a place rather than on it: what is said of some targets only means more than what is said of all.
    relations.sort(key=lambda relation: (relation.joins[1] == ROOT, relation.name not in achievable_names))
    return Placings(formulas=tuple(str(Relation(relation.name, (Name(object.name), Name(target.name)))) for relation in relations))

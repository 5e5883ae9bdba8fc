"""The objects of things on the map: their values at first, and the definitions that they need."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Iterable, Iterator

from somrs.adapters.things.mapping import ThingEntry
from somrs.adapters.things.model import Thing
from somrs.adapters.things.naming import object_name
from somrs.entish.parse import nearest
from somrs.ontology.conformance import violations_of
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.naming import find_definition, key_of
from somrs.ontology.objects import Object
from somrs.ontology.types import Definition, Kind, Ontology, Value
from somrs.ontology.units import convert_unit
from somrs.service_manager.sdk.map_reader import MapReader

log = logging.getLogger(__name__)

_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+))\s*(\S.*?)\s*")
AREA = "AbstractObject"
"""The type of what things are parts of: rooms, storeys, buildings."""
_POSITION = ("PositionX", "PositionY", "PositionZ")

Problems = list[tuple[tuple[str | int, ...], str]]


def initial_values(name: str, entry: ThingEntry, ontology: Ontology) -> tuple[dict[str, Value], Problems]:
    """The values with which a thing comes onto the map, in the units of their attributes, and what is wrong with them.

    That values are missing is no problem: the thing may be on the map already.
    """
    attributes, problems = ontology.attributes_of(entry.type), Problems()
    values: dict[str, Value] = {}
    written = [*zip(_POSITION, entry.at or (), strict=False), *entry.values.items()]
    for path, value in written:
        key = ("values", path) if path in entry.values else ("at",)
        attribute = attributes.get(path)
        if attribute is not None and attribute.kind is Kind.NUMBER and isinstance(value, str):
            match = _QUANTITY.fullmatch(value)
            number = convert_unit(float(match[1]), match[2], attribute.unit) if match and attribute.unit else None
            if number is None:
                problems.append((key, f"{path} is a number{f' in {attribute.unit}' if attribute.unit else ''}, not {value!r}"))
                continue
            value = number
        values[path] = value
    for violation in violations_of(Map([Object(name=name, type=entry.type, values=values)], ()), ontology, [name]):
        if violation.path in values:
            problems.append((("values", violation.path), violation.message))
    return values, problems


def area_problem(thing: Thing, map: Map, ontology: Ontology) -> str | None:
    """Why a thing cannot be a part of its area on the map; None if it can, or if something else says where it is."""
    if not thing.area or thing.situation is not None or "PositionX" in thing.values or thing.name in map.objects:
        return None
    names = {thing.area, object_name(thing.area, ())}
    candidates = [object for object in map.objects.values() if object.name in names or object.values.get("Label") == thing.area]
    if not candidates:
        return f"area: the map has no {thing.area}, by name or label; {nearest(thing.area, map.objects) or 'write a room or a storey'}"
    if any(object.type not in ontology.types or ontology.is_subtype(object.type, AREA) for object in candidates):
        return None
    return f"area: {thing.area} is a {candidates[0].type}, and no room and no storey; write that in which it is"


def type_problem(thing: Thing, map: Map, *ontologies: Ontology) -> str | None:
    """Why a thing is not the object of its name on the map; None if it may be."""
    object = map.objects.get(thing.name)
    if object is None or any(
        ontology.is_subtype(object.type, thing.type) or ontology.is_subtype(thing.type, object.type) for ontology in ontologies
    ):
        return None
    return f"is a {object.type} on the map, and a {thing.type} here; name another object, or correct one of the types"


async def whereabouts(map: MapReader, thing: Thing) -> str | None:
    """What says where a thing is when it comes onto the map: its situation; else, without a position, what it is a part of."""
    if thing.situation is not None or "PositionX" in thing.values:
        return thing.situation
    areas = await _areas(map, thing.area) if thing.area else []
    for query in (*areas, "?Place: AbstractObject = ?Place AND NOT ?Place isPartOf ?Whole: Object"):
        if rows := await map.query(query, limit=1):
            place = rows[0]["Place"]
            if thing.area and "?Named isPartOf" in query:
                log.warning("%s: %s is no room and no storey: it becomes a part of %s; correct its area", thing.name, thing.area, place)
            elif thing.area and query not in areas:
                text = "%s: the map has no %s, by name or label: it becomes a part of %s; correct its area"
                log.warning(text, thing.name, thing.area, place)
            return f"{thing.name} isPartOf {place}"
    return None


async def _areas(map: MapReader, area: str) -> list[str]:
    """The questions for the room or storey of this name or label; then for that in which something else of this name or label is."""
    names = [name for name in dict.fromkeys((area, object_name(area, ()))) if await map.object(name) is not None]
    named = [*(f"?Named: Object = {name}" for name in names), f"?Named: Object.Label = {json.dumps(area)}"]
    return [
        f"{query} AND {part}" for part in ("?Place: AbstractObject = ?Named", "?Named isPartOf ?Place: AbstractObject") for query in named
    ]


def definitions_for(type: str, services: Iterable[str], ontology: Ontology) -> tuple[Definition, ...]:
    """The definitions that a thing of the type needs, and that the upper ontology does not have."""
    base = upper(2)
    definitions = {key_of(definition): definition for definition in _definitions_of(type, services, ontology)}
    return tuple(definition for key, definition in definitions.items() if find_definition(base, key) is None)


def _definitions_of(type: str, services: Iterable[str], ontology: Ontology) -> Iterator[Definition]:
    for ancestor in ontology.ancestors(type):
        yield ontology.types[ancestor]
    yield from ontology.attributes_of(type).values()
    for name in services:
        service = ontology.services[name]
        yield service
        for parameter in service.inputs:
            for ancestor in ontology.ancestors(parameter.type):
                yield ontology.types[ancestor]

"""Writes ontologies and maps as YAML that `loading.py` reads back."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import yaml

from somrs.ontology.files.levels import level_of
from somrs.ontology.files.nodes import Dumper, Lines
from somrs.ontology.map import Map
from somrs.ontology.naming import find_definition, key_of
from somrs.ontology.objects import Fact, Object
from somrs.ontology.services import ServiceKind, ServiceType
from somrs.ontology.types import ABSTRACT, PART_OF, AttributeType, Constraint, FunctionType, ObjectType, Ontology, Part, RelationType, Value

_POSITION = ("PositionX", "PositionY", "PositionZ")


def dump_map(map: Map, ontology: Ontology, name: str | None = None) -> str:
    """The map as YAML text: parts nested in their wholes, positions and rotations in the short forms `at` and `turned`.

    `name`: of the map; None: its own, or that of its root.
    """
    parts: dict[str, list[str]] = {}
    wholes: dict[str, str] = {}
    for fact in map.facts(PART_OF):
        part, whole = fact.arguments
        if part in map.objects and whole in map.objects and part not in wholes:
            wholes[part] = whole
            parts.setdefault(whole, []).append(part)
    nested: set[str] = set()

    def tree(object: Object) -> dict[str, Any]:
        body = _object(object)
        nested.add(object.name)
        child_parts = [part for part in parts.get(object.name, ()) if part not in nested]
        if child_parts:
            body["parts"] = {part: tree(map.objects[part]) for part in child_parts}
        return body

    objects = {object.name: tree(object) for object in map.objects.values() if object.name not in wholes}
    facts = [str(fact) for fact in map.facts() if not (fact.relation == PART_OF and wholes.get(fact.arguments[0]) == fact.arguments[1])]
    for looped in map.objects.keys() - nested:  # objects in a cycle of parts: no tree contains them
        objects[looped] = _object(map.objects[looped])
        facts.append(str(Fact(PART_OF, (looped, wholes[looped]))))
    return _yaml({"map": name or name_of(map, ontology) or "map", "objects": objects, **({"facts": Lines(facts)} if facts else {})})


def name_of(map: Map, ontology: Ontology) -> str | None:
    """The name of the map, or of the abstract object that is its root, or of any root; None for a map without objects."""
    roots = [*map.roots()]
    abstract = (root for root in roots if ontology.is_subtype(map.objects[root].type, ABSTRACT))
    return map.name or next(abstract, next(iter(roots), None))


def _object(object: Object) -> dict[str, Any]:
    values = dict(object.values)
    body: dict[str, Any] = {"type": object.type}
    if all(_is_number(values.get(path)) for path in _POSITION[:2]):
        written = _POSITION if _is_number(values.get("PositionZ")) else _POSITION[:2]
        body["at"] = [_plain(values.pop(path)) for path in written]
    if _is_number(values.get("RotationZ")):
        body["turned"] = _plain(values.pop("RotationZ"))
    return {**body, **_nested(values)}


def _nested(values: dict[str, Value]) -> dict[str, Any]:
    """The values as a tree: `Shape.Height: 1` becomes `Shape: {Height: 1}`."""
    tree: dict[str, Any] = {}
    for path, value in values.items():
        *outer, leaf_key = path.split(".")
        node = tree
        for step in outer:
            inner = node.setdefault(step, {})
            if not isinstance(inner, dict):  # both the path and a path below it have values: invalid, but kept
                node, leaf_key = tree, path
                break
            node = inner
        if isinstance(node.get(leaf_key), dict):
            node, leaf_key = tree, path
        node[leaf_key] = _plain(value)
    return tree


def dump_ontology(ontology: Ontology, base: Ontology | None = None, name: str | None = None, *, whole: bool = False) -> str:
    """The ontology as YAML text, without the definitions that `base` has (with `whole`: with them).

    The key `without` lists the definitions of `base` that the ontology redefines or lacks.
    """
    text: dict[str, Any] = {"upper": level_of(base)} if base is not None and level_of(base) > 1 else {}
    text |= {"ontology": name} if name else {}
    if base is not None and (overridden_names := [*_overridden_names(ontology, base)]):
        text["without"] = overridden_names
    for section, entry in (
        ("attributes", _attribute),
        ("relations", _relation),
        ("functions", _function),
        ("types", _type),
        ("services", _service),
    ):
        base_definitions = getattr(base, section) if base is not None and not whole else {}
        entries = {d.name: entry(d) for d in getattr(ontology, section).values() if base_definitions.get(d.name) != d}
        if entries:
            text[section] = entries
    return _yaml(text)


def _overridden_names(ontology: Ontology, base: Ontology) -> Iterator[str]:
    """The definitions of `base` that the ontology redefines or lacks."""
    for definition in base:
        definition_key = key_of(definition)
        if find_definition(ontology, definition_key) != definition:
            yield f"{definition_key.section} {definition_key.name}"


def _attribute(attribute: AttributeType) -> dict[str, Any]:
    body = {"kind": attribute.kind.value, **_fields(attribute, "unit", "tolerance", "minimum", "maximum", "values", "attributes")}
    if attribute.constraints:
        body["constraints"] = [_constraint(constraint) for constraint in attribute.constraints]
    return {**body, **_fields(attribute, "doc")}


def _relation(relation: RelationType) -> dict[str, Any]:
    return _fields(relation, "joins", "symmetric", "functional", "excludes", "doc")


def _function(function: FunctionType) -> dict[str, Any]:
    return _fields(function, "parameters", "attribute", "values", "unit", "doc")


def _type(type: ObjectType) -> dict[str, Any]:
    body = _fields(type, "parent", "attributes", "required", "driver", "doc")
    if type.parts:
        body["parts"] = [_part(part) for part in type.parts]
    if type.closed:
        body["closed"] = True
    if type.constraints:
        body["constraints"] = [_constraint(constraint) for constraint in type.constraints]
    if type.defaults:
        body["defaults"] = _nested(type.defaults)
    return body


def _part(part: Part) -> dict[str, Any]:
    return {"type": part.type, "minimum": part.minimum, **_fields(part, "maximum")}


def _constraint(constraint: Constraint) -> dict[str, Any]:
    return _fields(constraint, "attribute", "minimum", "maximum", "values", "formula", "doc")


def _service(service: ServiceType) -> dict[str, Any]:
    body: dict[str, Any] = {"kind": service.kind.value} if service.kind is not ServiceKind.PHYSICAL else {}
    for side in ("inputs", "outputs"):
        if getattr(service, side):
            body[side] = {parameter.name: parameter.type for parameter in getattr(service, side)}
    handlers = [{"on": handler.on.value, **_fields(handler, "when", "effect")} for handler in service.handlers]
    return {
        **body,
        **_fields(service, "parent", "precondition"),
        **({"while": service.invariant} if service.invariant is not None else {}),
        **_fields(service, "effect", "cost"),
        **({"handlers": handlers} if handlers else {}),
        **_fields(service, "doc"),
    }


def _fields(definition: Any, *names: str) -> dict[str, Any]:
    """The fields of a definition that differ from their defaults: None, false, 0 and empty lists are left out, except limits of 0."""
    written_fields: dict[str, Any] = {}
    for name in names:
        value = getattr(definition, name)
        if value or (value == 0 and name in ("minimum", "maximum") and value is not None):
            written_fields[name] = _plain(value)
    return written_fields


def _is_number(value: Value | None) -> bool:
    return isinstance(value, float | int) and not isinstance(value, bool)


def _plain(value: Any) -> Any:
    """The value for YAML: tuples as lists, and whole numbers without a decimal point, which read back as the same numbers."""
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return int(value) if isinstance(value, float) and value.is_integer() and abs(value) < 1e15 else value


def _yaml(data: dict[str, Any]) -> str:
    return yaml.dump(data, Dumper=Dumper, sort_keys=False, allow_unicode=True, width=140, default_flow_style=None)

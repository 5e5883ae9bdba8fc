"""Checks a file against `schema.py`, and makes definitions from its entries. `loading.py` resolves the names in them."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

from pydantic import BaseModel

from somrs.entish import Number
from somrs.errors import Problem
from somrs.ontology.files.documents import model_misfits
from somrs.ontology.files.nodes import Path, Source
from somrs.ontology.schema import ENTRIES, AttributeEntry, ConstraintEntry, File, FunctionEntry, RelationEntry, ServiceEntry, TypeEntry
from somrs.ontology.services import Handler, Parameter, ServiceType
from somrs.ontology.types import AttributeType, Constraint, Definition, FunctionType, ObjectType, Part, RelationType, Value

_MAPPING = "a mapping file, which is named under `adapters: {things: {mappings: [FILE]}}` of a site"
_BINDING = "the binding of a robot, which is named under `adapters: {ros2: {robots: {NAME: {binding: FILE}}}}` of a site"
OTHER_FILES = {
    "things": _MAPPING,
    "connections": _MAPPING,
    **dict.fromkeys(("pose", "transform", "odometry", "navigate", "pick", "drop"), _BINDING),
}
"""What sections of files belong to that are no files of a site."""


def structure_problems(source: Source, further_sections: Collection[str] = ()) -> tuple[list[Problem], set[str]]:
    """The problems of the file's structure, and the names of the definitions and objects that cannot be used because of them.

    `further_sections`: keys that the file may have besides, with what they lead to.
    """
    if source.problems and source.data is None:
        return source.problems, set()
    if not isinstance(source.data, dict):
        message = f"a file is a list of keys ({', '.join((*File.model_fields, *further_sections))}) with values"
        return [*source.problems, Problem(file=source.file, line=1, subject="file", rule="structure", message=message)], set()
    problems: dict[tuple[int | None, str], Problem] = {}
    broken: set[str] = set()
    data = {key: value for key, value in source.data.items() if key not in further_sections}
    for path, kind, message in model_misfits(data, File, further_sections):
        owner = _owner(path)
        if owner is not None:
            broken.add(owner)
        if kind == "extra_forbidden" and len(path) == 1 and path[0] in OTHER_FILES:
            message = f"{path[0]} belongs into {OTHER_FILES[str(path[0])]}"
        subject, line = owner or (str(path[0]) if path else "file"), source.line(path)
        problem = Problem(file=source.file, line=line, subject=subject, rule="structure", message=message)
        problems.setdefault((line, str(path) if kind in ("missing", "extra_forbidden") else subject), problem)
    return [*source.problems, *problems.values()], broken


def definition(name: str, entry: BaseModel, defaults: dict[str, Value]) -> Definition:
    """The definition of an entry; `defaults` are those of a type, in the units of their attributes."""
    match entry:
        case AttributeEntry():
            constraints = _constraints(entry.constraints)
            lists = {"values": tuple(entry.values), "attributes": tuple(entry.attributes), "constraints": constraints}
            return AttributeType(**{**entry.model_dump(), "name": name, **lists})
        case RelationEntry():
            return RelationType(**{**entry.model_dump(), "name": name, "joins": tuple(entry.joins)})
        case FunctionEntry():
            return FunctionType(**{**entry.model_dump(), "name": name, "parameters": tuple(entry.parameters)})
        case ServiceEntry():
            inputs, outputs = (tuple(Parameter(name=n, type=t) for n, t in side.items()) for side in (entry.inputs, entry.outputs))
            handlers = tuple(Handler(**handler.model_dump()) for handler in entry.handlers)
            cost = str(Number(entry.cost)) if isinstance(entry.cost, float) else entry.cost
            fields = {**entry.model_dump(), "name": name, "inputs": inputs, "outputs": outputs, "handlers": handlers, "cost": cost}
            return ServiceType(**fields)
        case TypeEntry():
            return ObjectType(
                **{
                    **entry.model_dump(),
                    "name": name,
                    "attributes": tuple(entry.attributes),
                    "required": tuple(entry.required),
                    "parts": tuple(
                        Part(type=part.type, minimum=int(part.minimum), maximum=None if part.maximum is None else int(part.maximum))
                        for part in entry.parts
                    ),
                    "constraints": _constraints(entry.constraints),
                    "defaults": defaults,
                }
            )
    raise TypeError(f"{type(entry).__name__} defines nothing")


def _constraints(entries: list[ConstraintEntry]) -> tuple[Constraint, ...]:
    return tuple(Constraint(**{**entry.model_dump(), "values": tuple(entry.values)}) for entry in entries)


def flat(values: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Nested values by path: `Shape: {Height: 1}` and `Shape.Height: 1` are equivalent."""
    for key, value in values.items():
        if isinstance(value, dict):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _owner(path: Path) -> str | None:
    """The name of the definition or object that a path is in; None for other paths."""
    if len(path) < 2 or path[0] not in (*ENTRIES, "objects"):
        return None
    if path[0] != "objects":
        return str(path[1])
    owner, rest = path[1], path[2:]
    while len(rest) >= 2 and rest[0] == "parts":
        owner, rest = rest[1], rest[2:]
    return str(owner)

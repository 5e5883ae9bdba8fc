"""Objects and facts, and the changes of a map."""

from __future__ import annotations

from msgspec import Struct

from somrs.ontology.types import Value


class Object(Struct, frozen=True, kw_only=True, gc=False):
    """An instance of a type. `values` has attribute paths as keys (`PositionX`, `Shape.Height`); numbers are in the attribute's unit."""

    name: str
    type: str
    values: dict[str, Value] = {}


class Fact(Struct, frozen=True, gc=False):
    """A relation that holds between objects."""

    relation: str
    arguments: tuple[str, ...]

    def __str__(self) -> str:
        if len(self.arguments) == 2:
            return f"{self.arguments[0]} {self.relation} {self.arguments[1]}"
        return f"{self.relation}({', '.join(self.arguments)})"


class ObjectAdded(Struct, frozen=True, tag=True):
    object: Object


class ObjectRemoved(Struct, frozen=True, tag=True):
    """An object is removed, and with it every fact about it."""

    name: str


class ValueSet(Struct, frozen=True, tag=True):
    """An attribute of an object gets a value; None removes the value."""

    object: str
    path: str
    value: Value | None


class FactAdded(Struct, frozen=True, tag=True):
    fact: Fact


class FactRemoved(Struct, frozen=True, tag=True):
    fact: Fact


Change = ObjectAdded | ObjectRemoved | ValueSet | FactAdded | FactRemoved


def objects_of(change: Change) -> tuple[str, ...]:
    """The names of the objects that a change concerns."""
    match change:
        case ObjectAdded(object):
            return (object.name,)
        case ObjectRemoved(name) | ValueSet(name):
            return (name,)
        case FactAdded(fact) | FactRemoved(fact):
            return fact.arguments

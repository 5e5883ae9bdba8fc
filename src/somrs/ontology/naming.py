"""What definitions and objects are called: of which section of an ontology something is, by which name, and what it is to be called."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum

from msgspec import Struct

from somrs.ontology.services import ServiceType
from somrs.ontology.types import AttributeType, Definition, FunctionType, ObjectType, Ontology, RelationType


class Section(StrEnum):
    """Where something is named: each has names of its own."""

    ATTRIBUTES = "attributes"
    RELATIONS = "relations"
    FUNCTIONS = "functions"
    TYPES = "types"
    SERVICES = "services"
    OBJECTS = "objects"
    """Of the map."""


SINGULAR = {
    Section.ATTRIBUTES: "attribute",
    Section.RELATIONS: "relation",
    Section.FUNCTIONS: "function",
    Section.TYPES: "type",
    Section.SERVICES: "service type",
    Section.OBJECTS: "object",
}
"""What one of a section is called in a sentence."""


class Named(Struct, frozen=True, kw_only=True):
    """A definition, by its name."""

    section: Section
    name: str

    def __str__(self) -> str:
        return f"{SINGULAR[self.section]} {self.name}"


class Renaming(Struct, frozen=True, kw_only=True):
    """Something of the section gets another name."""

    section: Section
    name: str
    to: str

    def __str__(self) -> str:
        return f"{SINGULAR[self.section]} {self.name} to {self.to}"


def section_of(definition: Definition) -> Section:
    match definition:
        case AttributeType():
            return Section.ATTRIBUTES
        case RelationType():
            return Section.RELATIONS
        case FunctionType():
            return Section.FUNCTIONS
        case ObjectType():
            return Section.TYPES
        case ServiceType():
            return Section.SERVICES


def named(definition: Definition) -> Named:
    return Named(section=section_of(definition), name=definition.name)


def find(ontology: Ontology, what: Named) -> Definition | None:
    """The definition of that name, if there is one."""
    found: Definition | None = getattr(ontology, what.section).get(what.name) if what.section is not Section.OBJECTS else None
    return found


def revised(ontology: Ontology, removed: Iterable[Named], definitions: Iterable[Definition]) -> Ontology:
    """The ontology without what is removed, then with the definitions added or in place of those of the same names."""
    gone = set(removed)
    kept = ontology if not gone else (definition for definition in ontology if named(definition) not in gone)
    return Ontology([*kept, *definitions])

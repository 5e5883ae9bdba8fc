"""Names of definitions and objects: the section of an ontology that a name belongs to, keys of definitions, and renamings."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum

from msgspec import Struct

from somrs.ontology.services import ServiceType
from somrs.ontology.types import AttributeType, Definition, FunctionType, ObjectType, Ontology, RelationType


class Section(StrEnum):
    """A namespace: names are unique within a section."""

    ATTRIBUTES = "attributes"
    RELATIONS = "relations"
    FUNCTIONS = "functions"
    TYPES = "types"
    SERVICES = "services"
    OBJECTS = "objects"
    """The objects of the map."""


SINGULAR = {
    Section.ATTRIBUTES: "attribute",
    Section.RELATIONS: "relation",
    Section.FUNCTIONS: "function",
    Section.TYPES: "type",
    Section.SERVICES: "service type",
    Section.OBJECTS: "object",
}
"""The word for an element of each section, for texts."""


class DefinitionKey(Struct, frozen=True, kw_only=True):
    """The identity of a definition: its section and name."""

    section: Section
    name: str

    def __str__(self) -> str:
        return f"{SINGULAR[self.section]} {self.name}"


class Renaming(Struct, frozen=True, kw_only=True):
    """A definition or object of the section gets the new name `to`."""

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


def key_of(definition: Definition) -> DefinitionKey:
    return DefinitionKey(section=section_of(definition), name=definition.name)


def find_definition(ontology: Ontology, definition_key: DefinitionKey) -> Definition | None:
    """The definition with the key; None if the ontology does not have it, or for an object."""
    definition: Definition | None = (
        getattr(ontology, definition_key.section).get(definition_key.name) if definition_key.section is not Section.OBJECTS else None
    )
    return definition


def revise_ontology(ontology: Ontology, removed: Iterable[DefinitionKey], definitions: Iterable[Definition]) -> Ontology:
    """The ontology without the removed definitions, and with `definitions` added. They replace definitions of the same names."""
    removed_keys = set(removed)
    remaining_definitions = (
        ontology if not removed_keys else (definition for definition in ontology if key_of(definition) not in removed_keys)
    )
    return Ontology([*remaining_definitions, *definitions])

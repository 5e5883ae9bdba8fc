"""The structure of ontology and map files as pydantic models, and the JSON Schema that editors use for completion and checks."""

from __future__ import annotations

import json
from importlib import resources
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from somrs.ontology.services import Occasion, ServiceKind
from somrs.ontology.types import Kind

Plain = str | float | bool
Attributes = dict[str, Any]
Level = Annotated[float, Field(ge=1, le=2, multiple_of=1)]
Count = Annotated[float, Field(ge=0, multiple_of=1)]


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class ConstraintEntry(_Entry):
    """A rule for the objects of a type: limits of an attribute, or a formula about ?Self."""

    attribute: str | None = Field(None, description="An attribute, or a path into a complex one: Shape.Height")
    minimum: float | None = None
    maximum: float | None = None
    values: list[Plain] = Field(
        [], description="The values that the attribute may have; of a complex attribute: the complex attributes that it may conform to"
    )
    formula: str | None = Field(None, description="Entish; ?Self is the object, other typed variables are its sub-objects")
    doc: str = Field("", description="The meaning of the rule, for the message about a violation")


class AttributeEntry(_Entry):
    """A property of objects."""

    kind: Kind = Field(strict=False, description="number, text, truth, enumeration (one of `values`) or complex (made of `attributes`)")
    unit: str | None = Field(None, description="Of a number: a unit such as m, rad, kg, m/s, EUR, percent")
    tolerance: float = Field(0.0, ge=0, description="Of a number: two values that differ by at most this much, in the unit, are equal")
    minimum: float | None = None
    maximum: float | None = None
    values: list[str] = Field([], description="Of an enumeration: the possible values")
    attributes: list[str] = Field([], description="Of a complex attribute: the attributes it is made of")
    constraints: list[ConstraintEntry] = Field([], description="Of a complex attribute: limits of its attributes, by their paths below it")
    doc: str = ""


class RelationEntry(_Entry):
    """A relation between objects of the given types."""

    joins: list[str] = Field(min_length=1, description="The type of each argument")
    symmetric: bool = False
    functional: bool = Field(False, description="Each first argument occurs in at most one fact of the relation at a time")
    excludes: str | None = Field(None, description="A group: each first argument is in at most one relation of the group at a time")
    doc: str = ""


class FunctionEntry(_Entry):
    """A function of objects whose result is a number."""

    parameters: list[str] = Field(min_length=1, description="The type of each argument")
    attribute: str | None = Field(None, description="The attribute of its single argument that the function reads")
    values: dict[str, float] = Field({}, description="Its values, by the names of its arguments joined by spaces: Depot Harbour: 12")
    unit: str | None = None
    doc: str = ""


class PartEntry(_Entry):
    """Sub-objects that every object of the type has."""

    type: str
    minimum: Count = 1
    maximum: Count | None = None


class TypeEntry(_Entry):
    """A type of objects."""

    parent: str | None = Field(None, description="The type whose attributes and rules this type inherits")
    attributes: list[str] = Field([], description="Optional attributes of objects of the type")
    required: list[str] = Field([], description="Mandatory attributes of objects of the type")
    parts: list[PartEntry] = []
    closed: bool = Field(False, description="Objects of the type, and of types below it, have only parts of the types that parts declare")
    constraints: list[ConstraintEntry] = []
    defaults: Attributes = Field({}, description="Values of attributes that an object does not set itself")
    driver: str | None = Field(None, description="module:Class of the program that serves a device of the type")
    doc: str = ""


class HandlerEntry(_Entry):
    """A predefined procedure: a formula to make true when a step fails or is compensated."""

    on: Occasion = Field(strict=False, description="failure or compensation")
    effect: str = Field(description="Entish; the formula to make true, by any suitable services")
    when: str | None = Field(None, description="Entish; the situation in which the procedure applies")


class ServiceEntry(_Entry):
    """A type of service."""

    inputs: dict[str, str] = Field({}, description="Variables and their types: object types, or number, text and truth for values")
    outputs: dict[str, str] = {}
    precondition: str | None = Field(None, description="Entish; the formula that must hold before the service")
    invariant: str | None = Field(
        None, alias="while", description="Entish over the inputs and ?Provider; must hold as long as the service runs"
    )
    effect: str = Field(description="Entish; the formula that holds after the service")
    kind: ServiceKind = Field(ServiceKind.PHYSICAL, strict=False)
    parent: str | None = None
    handlers: list[HandlerEntry] = []
    cost: str | float | None = Field(None, description="The estimated cost: a number, or an Entish term over the inputs and ?Provider")
    doc: str = ""


class ObjectEntry(BaseModel):
    """An object: its type, its parts, and its attributes by name."""

    model_config = ConfigDict(extra="allow", frozen=True, strict=True)

    type: str
    at: list[str | float] | None = Field(None, min_length=2, max_length=3, description="PositionX, PositionY and, if given, PositionZ")
    turned: str | float | None = Field(None, description="RotationZ: counter-clockwise, in radians unless a unit is given: 90 deg")
    parts: dict[str, ObjectEntry] = Field({}, description="The objects that are integral parts of this one")


ENTRIES: dict[str, type[BaseModel]] = {
    "attributes": AttributeEntry,
    "relations": RelationEntry,
    "functions": FunctionEntry,
    "types": TypeEntry,
    "services": ServiceEntry,
}
"""The sections of a file that hold definitions, and the model of an entry in each."""

RESERVED = frozenset(ObjectEntry.model_fields)
"""Keys of an object that are not attributes."""


class File(_Entry):
    """A file with a part of an ontology, a part of a map, or both."""

    uses: list[str] = Field([], description="Files that this one builds on; paths are relative to this file")
    upper: Level = Field(1, description="The level of the upper ontology for which the file is written; 2 is the latest")
    ontology: str | None = Field(None, description="The ontology's name")
    without: list[str] = Field([], description="Definitions of the upper ontology that this file removes or redefines: types Jar")
    attributes: dict[str, AttributeEntry] = {}
    relations: dict[str, RelationEntry] = {}
    functions: dict[str, FunctionEntry] = {}
    types: dict[str, TypeEntry] = {}
    services: dict[str, ServiceEntry] = {}
    map: str | None = Field(None, description="The map's name")
    objects: dict[str, ObjectEntry] = Field({}, description="The map's objects; exactly one, the root, contains all others")
    adapters: dict[str, dict[str, Any]] = Field(
        {}, description="The adapters that connect robots and things of the site, such as vda5050, with their settings"
    )
    facts: list[str] = Field([], description="Relations that hold between objects, such as Jar002 isOn Cupboard001")


def json_schema() -> dict[str, Any]:
    """The JSON Schema of `File`."""
    schema = File.model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def published_schema() -> dict[str, Any]:
    """The JSON Schema file in the package."""
    schema: dict[str, Any] = json.loads(resources.files("somrs.ontology").joinpath("data/somrs.schema.json").read_text("utf-8"))
    return schema

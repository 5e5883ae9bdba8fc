"""The definitions of an ontology, as frozen values. Objects are in `objects.py`, service types in `services.py`.

Paper, "Environment representation": attributes, relations, and types with a parent, attributes, obligatory sub-objects and
constraints. Effects need two more properties of relations than the paper has: `functional` and `excludes`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from enum import StrEnum

from msgspec import Struct

from somrs.ontology.services import ServiceType

Value = float | str | bool

ROOT = "Object"
PHYSICAL = "PhysicalObject"
UNKNOWN = "Unknown"
"""The attribute that is TRUE for an object whose state is not known (upper ontology)."""

WORKING = "Working"
"""The attribute that is FALSE for a device that is out of order (upper ontology)."""

PROBLEM = "Problem"
"""The attribute that says why a device does not work, or cannot be reached (upper ontology)."""

PAUSED = "Paused"
PAUSED_FOR = "PausedFor"
"""The attribute that is TRUE for a device that must not move, because an operator has stopped it (upper ontology)."""

IN_SERVICE = "InService"
"""The attribute that is FALSE for a device that an operator has taken out of service (upper ontology)."""

MODE = "Mode"
"""The attribute of buildings, lifts and doors that says whether they can be used as usual (upper ontology); `modes.py` has its values."""

OUT_OF_ORDER = "OutOfOrder"
"""The mode of a lift or a door that nobody uses."""

DEVICE = "Device"
ABSTRACT = "AbstractObject"
PART_OF = "isPartOf"
"""The relation of a sub-object to the object that it is a part of. It is built in, because it defines the hierarchy of a map."""


class Kind(StrEnum):
    """The kind of an attribute's values."""

    NUMBER = "number"
    """A number, in the attribute's unit."""
    TEXT = "text"
    TRUTH = "truth"
    ENUMERATION = "enumeration"
    """A name from a fixed list."""
    COMPLEX = "complex"
    """A group of attributes, such as Shape."""


class Constraint(Struct, frozen=True, kw_only=True):
    """A rule for the objects of a type: a range or an enumeration for an attribute path, or a formula about `?Self`
    in which other typed variables denote its sub-objects.

    The `values` for a complex attribute are names of complex attributes: it conforms to one of them (Shape is CuboidFurnitureLegShape).
    """

    attribute: str | None = None
    minimum: float | None = None
    maximum: float | None = None
    values: tuple[Value, ...] = ()
    formula: str | None = None
    doc: str = ""
    """The meaning of the rule, for the message about a violation."""


class AttributeType(Struct, frozen=True, kw_only=True):
    """A property of objects. `unit` is a pint unit; numbers that differ by at most `tolerance`, in that unit, are equal.

    A complex attribute consists of `attributes`, and has `constraints` for their values; their paths begin below it (`Width`).
    """

    name: str
    kind: Kind
    unit: str | None = None
    tolerance: float = 0.0
    minimum: float | None = None
    maximum: float | None = None
    values: tuple[str, ...] = ()
    attributes: tuple[str, ...] = ()
    constraints: tuple[Constraint, ...] = ()
    doc: str = ""


class RelationType(Struct, frozen=True, kw_only=True):
    """A relation between objects, and the type of each argument (`joins`).

    `functional`: each first argument occurs in at most one fact of the relation at a time (a jar is on one thing).
    `excludes`: the name of a group; each first argument is in at most one relation of the group at a time (on, held by, in transit).
    """

    name: str
    joins: tuple[str, ...]
    symmetric: bool = False
    functional: bool = False
    excludes: str | None = None
    doc: str = ""


class FunctionType(Struct, frozen=True, kw_only=True):
    """A function of objects whose result is a number.

    With `attribute`, the function reads that attribute of its single argument (`range(?Provider)`). With `values`, it is a table whose
    keys are the names of the arguments, joined by spaces (`Depot Harbour`). With neither, SO-MRS computes it (`distance`).
    """

    name: str
    parameters: tuple[str, ...]
    attribute: str | None = None
    values: dict[str, float] = {}
    unit: str | None = None
    doc: str = ""


class Part(Struct, frozen=True, kw_only=True):
    """The sub-objects of one type that every object of the owning type has, and their number (`maximum` None: no limit)."""

    type: str
    minimum: int = 1
    maximum: int | None = None


class ObjectType(Struct, frozen=True, kw_only=True):
    """A type of objects.

    `attributes` are optional, `required` are mandatory; both add to those of the parent. `defaults` are the values of attributes that an
    object does not set itself. `driver` names the program (`module:Class`) that serves a device of the type. `closed`: objects of the
    type, and of types below it, have only parts of the types that `parts` declare; without any, they are elementary.
    """

    name: str
    parent: str | None
    attributes: tuple[str, ...] = ()
    required: tuple[str, ...] = ()
    parts: tuple[Part, ...] = ()
    closed: bool = False
    constraints: tuple[Constraint, ...] = ()
    defaults: dict[str, Value] = {}
    driver: str | None = None
    doc: str = ""


Definition = AttributeType | RelationType | FunctionType | ObjectType | ServiceType


class Ontology:
    """All definitions by name. An ontology is immutable: `extended` returns a new one."""

    def __init__(self, definitions: Iterable[Definition] = ()) -> None:
        self.attributes: dict[str, AttributeType] = {}
        self.relations: dict[str, RelationType] = {}
        self.functions: dict[str, FunctionType] = {}
        self.types: dict[str, ObjectType] = {}
        self.services: dict[str, ServiceType] = {}
        self._ancestors: dict[str, tuple[str, ...]] = {}
        self._attributes_of: dict[str, Mapping[str, AttributeType]] = {}
        self._spread_out: dict[str, Mapping[str, AttributeType]] = {}
        self._rivals: dict[str, tuple[tuple[str, int], ...]] = {}
        self._defaults: dict[tuple[str, str], Value | None] = {}
        for definition in definitions:
            match definition:
                case AttributeType():
                    self.attributes[definition.name] = definition
                case RelationType():
                    self.relations[definition.name] = definition
                case FunctionType():
                    self.functions[definition.name] = definition
                case ObjectType():
                    self.types[definition.name] = definition
                case ServiceType():
                    self.services[definition.name] = definition

    def __iter__(self) -> Iterator[Definition]:
        yield from self.attributes.values()
        yield from self.relations.values()
        yield from self.functions.values()
        yield from self.types.values()
        yield from self.services.values()

    def extended(self, definitions: Iterable[Definition]) -> Ontology:
        """This ontology with more definitions. A definition replaces an existing one of the same name."""
        return Ontology([*self, *definitions])

    def ancestors(self, type_name: str) -> tuple[str, ...]:
        """The type itself, its parent, and so on up to the root. Unknown types and cycles end the sequence."""
        if (cached_ancestors := self._ancestors.get(type_name)) is not None:
            return cached_ancestors
        ancestor_names: dict[str, None] = {}
        current: str | None = type_name
        while current is not None and current in self.types and current not in ancestor_names:
            ancestor_names[current] = None
            current = self.types[current].parent
        return self._ancestors.setdefault(type_name, tuple(ancestor_names))

    def is_subtype(self, type_name: str, ancestor: str) -> bool:
        """Whether every object of `type_name` is also an object of `ancestor`."""
        return ancestor == ROOT or ancestor in self.ancestors(type_name)

    def subtypes(self, type_name: str) -> Iterator[str]:
        """The type itself and all its subtypes."""
        return (name for name in self.types if self.is_subtype(name, type_name))

    def attributes_of(self, type_name: str) -> Mapping[str, AttributeType]:
        """The attributes of the type by path (`Shape.Height`): own and inherited ones; complex ones with all attributes in them."""
        if (cached_attributes := self._attributes_of.get(type_name)) is not None:
            return cached_attributes
        attributes: dict[str, AttributeType] = {}
        for ancestor in self.ancestors(type_name):
            for name in (*self.types[ancestor].attributes, *self.types[ancestor].required):
                if (spread := self._spread_out.get(name)) is None:
                    spread = self._spread_out.setdefault(name, dict(self._spread(name, name)))
                attributes.update(spread)
        return self._attributes_of.setdefault(type_name, attributes)

    def _spread(self, name: str, path: str) -> Iterator[tuple[str, AttributeType]]:
        attribute = self.attributes.get(name)
        if attribute is None or path.count(".") > 8:
            return
        yield path, attribute
        for inner in attribute.attributes:
            yield from self._spread(inner, f"{path}.{inner}")

    def default(self, type_name: str, path: str) -> Value | None:
        """The default value at the path: the type's own or the nearest ancestor's; None without one."""
        key = type_name, path
        if key not in self._defaults:
            definitions = (self.types[ancestor].defaults for ancestor in self.ancestors(type_name))
            self._defaults[key] = next((defaults[path] for defaults in definitions if path in defaults), None)
        return self._defaults[key]

    def rivals(self, relation: RelationType) -> tuple[tuple[str, int], ...]:
        """The relations whose facts about an object a new fact with it as the first argument replaces, each with the object's place in
        these facts, counted from 0: the relation itself, if it is functional, and those of the group that it `excludes`."""
        if (cached_rivals := self._rivals.get(relation.name)) is not None:
            return cached_rivals
        others = [
            other
            for other in self.relations.values()
            if (
                relation.functional
                if other.name == relation.name
                else relation.excludes is not None and other.excludes == relation.excludes
            )
        ]
        rivals = tuple((other.name, place) for other in others for place in ((0, 1) if other.symmetric else (0,)))
        return self._rivals.setdefault(relation.name, rivals)

    def is_closed(self, type_name: str) -> bool:
        """Whether objects of the type have only parts of the types that it declares."""
        return any(self.types[ancestor].closed for ancestor in self.ancestors(type_name))

    def parts_of(self, type_name: str) -> tuple[Part, ...]:
        """The parts that the type declares: own and inherited ones."""
        return tuple(part for ancestor in self.ancestors(type_name) for part in self.types[ancestor].parts)

    def is_device(self, type_name: str) -> bool:
        """Whether objects of the type are devices by themselves: those below Device, and those that a driver serves.

        Any other physical object becomes a device when a program offers services for it.
        """
        return self.is_subtype(type_name, DEVICE) or self.driver(type_name) is not None

    def driver(self, type_name: str) -> str | None:
        """The driver of the type: its own or the nearest ancestor's; None without one."""
        return next((d for ancestor in self.ancestors(type_name) if (d := self.types[ancestor].driver)), None)

"""The levels of the upper ontology: how obligations are added to it without making existing files invalid.

`upper.yaml` describes the latest level. A file of a site says with `upper: 2` for which level it was written; without the key, it is level
1, which has none of the definitions and obligations that are listed here. A running system keeps its own copy of the ontology and is not
affected.
"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import structs

from somrs.ontology.naming import DefinitionKey, Section, key_of
from somrs.ontology.types import Constraint, Definition, ObjectType, Ontology, Part

LATEST = 2

ADDED_IN_2 = frozenset(
    (
        DefinitionKey(section=Section.ATTRIBUTES, name="Volume"),
        DefinitionKey(section=Section.ATTRIBUTES, name="CuboidFurnitureLegShape"),
        DefinitionKey(section=Section.TYPES, name="TableTop"),
    )
)
"""Definitions whose names existing files may use for definitions of their own."""

OBLIGATORY_IN_2 = frozenset((("CuboidRoom", "Ceiling"), ("Table", "FurnitureLeg")))
"""Parts that are optional on level 1: the type of the whole, and of the part."""


LIBRARY = frozenset(
    DefinitionKey(section=Section.SERVICES, name=name)
    for name in (
        "MoveTo", "ChargeBattery", "CallLift", "OpenDoor", "CloseDoor", "OpenCupboard", "CloseCupboard", "PutInto", "TakeOutOf",
        "WeighObject", "LookAt", "LookInto",
    )
) | {DefinitionKey(section=Section.TYPES, name="Scale")}  # fmt: skip
"""Service types of the shipped devices, and types of devices, whose names a site or a device may use for a definition of its own, which
then replaces them."""


def at_level(ontology: Ontology, level: int) -> Ontology:
    """The upper ontology as it is on a level; `ontology` is that of the latest level."""
    return ontology if level >= LATEST else Ontology(_level_1(ontology))


def level_of(ontology: Ontology) -> int:
    """The level of the upper ontology that an ontology builds on, from its definitions."""
    names = {definition.name for definition in ADDED_IN_2 if definition.section is Section.TYPES}
    return LATEST if names <= ontology.types.keys() and any(type.closed for type in ontology.types.values()) else 1


def _level_1(ontology: Ontology) -> Iterator[Definition]:
    attributes, types = ({key.name for key in ADDED_IN_2 if key.section is section} for section in (Section.ATTRIBUTES, Section.TYPES))

    def is_known(constraint: Constraint) -> bool:
        return attributes.isdisjoint(value for value in constraint.values if isinstance(value, str))

    def part(whole: str, declared: Part) -> Part:
        return structs.replace(declared, minimum=0, maximum=None) if (whole, declared.type) in OBLIGATORY_IN_2 else declared

    for definition in ontology:
        if key_of(definition) in ADDED_IN_2:
            continue
        if isinstance(definition, ObjectType):
            yield structs.replace(
                definition,
                attributes=tuple(name for name in definition.attributes if name not in attributes),
                parts=tuple(part(definition.name, declared) for declared in definition.parts if declared.type not in types),
                closed=False,
                constraints=tuple(filter(is_known, definition.constraints)),
            )
        else:
            yield definition

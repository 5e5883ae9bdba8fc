"""The definitions that SO-MRS itself relies on, because its programs use them by name.

They can be extended, but not removed or renamed, and their meaning must stay the same. Definitions that only describe appearance, or
serve as examples, are not among them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from somrs.ontology.conformance import Violation
from somrs.ontology.naming import DefinitionKey, Section, find_definition
from somrs.ontology.types import AttributeType, Definition, FunctionType, ObjectType, Ontology, RelationType

REQUIRED_NAMES: Mapping[Section, frozenset[str]] = {
    Section.ATTRIBUTES: frozenset(
        (
            "PositionX", "PositionY", "PositionZ", "RotationY", "RotationZ",
            "Shape", "Form", "Width", "Depth", "Height", "Radius", "Outline",
            "Weight", "Color", "Label", "Elevation", "Open",
            "OperationRange", "FieldOfView", "Accuracy", "Payload", "Speed", "Price", "Charge", "Supporting",
            "ExternalId", "DoorKind", "SwingAngle", "NavigationGraph", "Bidirectional", "SpeedLimit", "Travel", "Mutex", "LaneWidth",
            "HoldingPoint", "ParkingSpot", "PassthroughPoint", "CleaningZone", "DockName", "Latitude", "Longitude",
            "Offers", "StepTime", "AnswerTime", "Unknown", "Working", "Problem", "Paused", "PausedFor", "InService", "Mode",
        )
    ),
    Section.RELATIONS: frozenset(
        (
            "isPartOf", "isOn", "isIn", "isHeldBy", "isAt", "isBookedFor",
            "startsAt", "endsAt", "interactsAt", "stopsAt", "leadsInto", "standsAt",
        )
    ),
    Section.FUNCTIONS: frozenset(("distance",)),
    Section.TYPES: frozenset(
        (
            "Object", "PhysicalObject", "AbstractObject", "Building", "Storey", "Space",
            "BuildingElement", "Wall", "Floor", "Ceiling", "Window", "Passage", "Opening", "Door", "PoweredDoor",
            "AutomaticDoor", "Place", "Charger", "Waypoint", "Lane", "Station", "Zone", "NoGoZone", "SlowZone", "Hole", "Pedestrian",
            "Furniture", "FurnitureLeg", "Support", "Cupboard", "Graspable",
            "Device", "Person", "StationaryDevice", "Scale", "Camera", "Lift", "MobileRobot", "Vehicle", "MobileManipulator", "PatrolRobot",
        )
    ),
    Section.SERVICES: frozenset(
        (
            "TransferObject", "RecognizeSituation", "MoveTo", "ChargeBattery",
            "CallLift", "OpenDoor", "CloseDoor", "OpenCupboard", "CloseCupboard", "PutInto", "TakeOutOf", "WeighObject",
            "LookAt", "LookInto",
        )
    ),
}  # fmt: skip


def required_definitions(ontology: Ontology) -> tuple[DefinitionKey, ...]:
    """The definitions of the ontology that SO-MRS relies on."""
    definition_keys = (DefinitionKey(section=section, name=name) for section, names in REQUIRED_NAMES.items() for name in sorted(names))
    return tuple(definition_key for definition_key in definition_keys if find_definition(ontology, definition_key) is not None)


def lost_dependencies(ontology_before: Ontology, ontology_after: Ontology) -> Iterator[Violation]:
    """Violations for the definitions that SO-MRS relies on, and that a change of the ontology removes or alters."""
    for definition_key in required_definitions(ontology_before):
        old, new = find_definition(ontology_before, definition_key), find_definition(ontology_after, definition_key)
        if new is None:
            message = (
                "SO-MRS itself relies on it, so it can be neither removed nor renamed; leave it as it is, and define another beside it"
            )
            yield Violation(subject=definition_key.name, rule="relied", message=message, section=definition_key.section)
        elif old is not None and old != new:
            for path, required_value in _changed_keys(old, new, ontology_before, ontology_after):
                message = f"SO-MRS itself relies on it, so {path} must stay {required_value}; define another beside it"
                yield Violation(subject=definition_key.name, rule="relied", message=message, path=path, section=definition_key.section)


def _changed_keys(old: Definition, new: Definition, ontology_before: Ontology, ontology_after: Ontology) -> Iterator[tuple[str, str]]:
    """The keys that must not change but did, and their required values."""
    match old, new:
        case AttributeType(), AttributeType():
            if old.kind is not new.kind:
                yield "kind", old.kind.value
            if old.unit != new.unit:
                yield "unit", old.unit or "left out"
        case RelationType(), RelationType():
            if len(old.joins) != len(new.joins):
                yield "joins", f"a list of {len(old.joins)} types"
            for key in ("symmetric", "functional", "excludes"):
                if getattr(old, key) != getattr(new, key):
                    yield key, str(getattr(old, key))
        case FunctionType(), FunctionType():
            if len(old.parameters) != len(new.parameters):
                yield "parameters", f"a list of {len(old.parameters)} types"
        case ObjectType(), ObjectType():
            # The parent may change, as long as the type keeps the ancestors that SO-MRS relies on.
            required_ancestors = [name for name in ontology_before.ancestors(old.name)[1:] if name in REQUIRED_NAMES[Section.TYPES]]
            if lost_ancestors := [name for name in required_ancestors if not ontology_after.is_subtype(new.name, name)]:
                yield "parent", f"{lost_ancestors[0]}, or a type below it"

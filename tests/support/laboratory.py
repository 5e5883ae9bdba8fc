"""A laboratory with jars, a washer, doors and robots: its service types, its map and problems in it."""

from __future__ import annotations

from somrs.entish.parse import parse
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import AttributeType, Kind, ObjectType, Ontology, RelationType
from somrs.planner.model.plan import Plan
from somrs.planner.model.problem import AvailableService, Problem
from somrs.protocol.messages.directory import Offer

TRANSFER = ServiceType(
    name="TransferObject",
    inputs=(Parameter(name="Object", type="Graspable"), Parameter(name="Destination", type="Object")),
    precondition="?Object isOn ?Source",
    effect="?Object isOn ?Destination",
)
WASH = ServiceType(
    name="WashJar", inputs=(Parameter(name="Jar", type="Jar"),), precondition="?Jar isOn ?Provider", effect="?Jar.Clean = TRUE"
)
OPEN = ServiceType(name="OpenDoor", inputs=(Parameter(name="Door", type="Door"),), effect="?Door.Open = TRUE")
DRIVE = ServiceType(
    name="DriveTo",
    inputs=(Parameter(name="To", type="Space"),),
    precondition="?Provider isInside ?From AND connects(?Door, ?From, ?To) AND ?Door.Open = TRUE",
    effect="?Provider isInside ?To",
)
LABEL = ServiceType(
    name="PrintLabel",
    inputs=(Parameter(name="Jar", type="Jar"), Parameter(name="Text", type="text")),
    precondition="?Jar.Clean = TRUE",
    effect="?Jar.Label = ?Text",
)


def laboratory() -> Ontology:
    return upper().extended(
        [
            AttributeType(name="Clean", kind=Kind.TRUTH),
            ObjectType(name="Jar", parent="Graspable", attributes=("Clean",)),
            ObjectType(name="Washer", parent="StationaryDevice"),
            RelationType(name="isInside", joins=("Device", "Space"), functional=True),
            RelationType(name="connects", joins=("Passage", "Space", "Space")),
        ]
    )


OBJECTS = {
    "Jar001": "Jar",
    "Jar002": "Jar",
    "Shelf1": "Shelf",
    "Shelf2": "Shelf",
    "Platform001": "Platform",
    "Washer1": "Washer",
    "Robot1": "DeliveryRobot",
    "RoomA": "Room",
    "RoomB": "Room",
    "DoorAB": "Door",
}
FACTS = [
    Fact("isOn", ("Jar001", "Shelf1")),
    Fact("isOn", ("Jar002", "Shelf1")),
    Fact("isInside", ("Robot1", "RoomA")),
    Fact("connects", ("DoorAB", "RoomA", "RoomB")),
    Fact("connects", ("DoorAB", "RoomB", "RoomA")),
]
MAP = Map((Object(name=name, type=type_name) for name, type_name in OBJECTS.items()), FACTS)


def make_problem(goal: str, *services: ServiceType, map: Map = MAP, excluded: frozenset[str] = frozenset()) -> Problem:
    offered = tuple(AvailableService(service, ("Washer1",) if service is WASH else ("Robot1",)) for service in services)
    return Problem(ontology=laboratory(), map=map, goal=parse(goal), services=offered, excluded=excluded)


def names(result: Plan) -> list[str]:
    return [str(step) for step in result.steps]


def offer(name: str, service_type: ServiceType = TRANSFER) -> Offer:
    """A service of a device of this name."""
    service = f"{name}.{service_type.name}"
    return Offer(service=service, provider=name, provider_type="DeliveryRobot", address=name, service_type=service_type)

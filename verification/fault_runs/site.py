"""The building in which a story plays: its ontology, the same for all stories, and its map."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.objects import Fact, Map, Object
from somrs.ontology.services import ServiceType
from somrs.ontology.types import PART_OF, Ontology, Value
from verification.fault_runs.story import Setting, Story

FLOOR = "Floor1"
"""Where things come to lie that are dropped."""

ONTOLOGY = """
ontology: faults
relations:
  isBehind: {joins: [Shelf, Door], functional: true}
services:
  CarryObject:
    inputs: {Object: Graspable, Table: Table}
    precondition: "?Object isOn ?Source"
    effect: "?Object isOn ?Table"
  StoreObject:
    inputs: {Object: Graspable, Shelf: Shelf}
    precondition: "?Object isOn ?Source AND ?Shelf isBehind ?Door AND ?Door.Open = TRUE"
    effect: "?Object isOn ?Shelf"
  OpenDoor:
    inputs: {Door: Door}
    precondition: "?Door.Open = FALSE"
    effect: "?Door.Open = TRUE"
  CloseDoor:
    inputs: {Door: Door}
    precondition: "?Door.Open = TRUE"
    effect: "?Door.Open = FALSE"
  PickUp:
    inputs: {Object: Graspable}
    precondition: "?Object isOn ?Source"
    effect: "?Object isHeldBy ?Provider"
  PutDown:
    inputs: {Object: Graspable, Place: Support}
    precondition: "?Object isHeldBy ?Provider"
    effect: "?Object isOn ?Place"
"""

LOOKING = "RecognizeSituation"

SERVICES: dict[Setting, tuple[tuple[str, ...], ...]] = {
    Setting.FLAT: (("TransferObject",),),
    Setting.DOORS: (("CarryObject",), ("StoreObject",), ("OpenDoor", "CloseDoor"), ("CarryObject", "StoreObject")),
    Setting.GRIP: (("PickUp", "PutDown"),),
}
"""What the devices of a setting can do, in turn, so that there is always one for each step."""


@cache
def ontology() -> Ontology:
    return load_text(ONTOLOGY, "faults", base=upper()).ontology


@cache
def service_type(name: str) -> ServiceType:
    return ontology().services[name]


def map_of(story: Story) -> Map:
    """The map as it is at the beginning, with the devices on it."""
    return Map(_objects(story), _facts(story))


def _objects(story: Story) -> Iterator[Object]:
    def placed(name: str, type: str, **more: Value) -> Object:
        box: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": 1.0, "Shape.Depth": 1.0, "Shape.Height": 0.8}
        return Object(name=name, type=type, values={"PositionX": 1.0, "PositionY": 1.0, "PositionZ": 0.0, **box, **more})

    yield Object(name="Building1", type="Building")
    yield Object(name="Storey1", type="Storey")
    yield placed(FLOOR, "Floor")
    yield from (placed(table, "Table") for table in story.tables)
    yield from (placed(shelf, "Shelf") for shelf, _ in story.shelves)
    yield from (placed(door, "Door", Open=is_open) for door, is_open in story.doors)
    yield from (placed(thing, "Jar") for thing, _ in story.things)
    yield from (placed(device.name, "PioneerP3DX") for device in story.devices)


def _facts(story: Story) -> Iterator[Fact]:
    yield Fact(PART_OF, ("Storey1", "Building1"))
    yield Fact(PART_OF, (FLOOR, "Storey1"))
    standing = [*story.tables, *(s for s, _ in story.shelves), *(d for d, _ in story.doors), *(t for t, _ in story.things)]
    yield from (Fact(PART_OF, (name, "Storey1")) for name in [*standing, *(device.name for device in story.devices)])
    yield from (Fact("isBehind", (shelf, door)) for shelf, door in story.shelves)
    yield from (Fact("isOn", (thing, place)) for thing, place in story.things)

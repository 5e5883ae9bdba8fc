"""The building of a scenario: its ontology, which all scenarios share, and its map."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.services import ServiceType
from somrs.ontology.types import PART_OF, Ontology, Value
from verification.fault_runs.scenario import Scenario, Setting, floor_of

FLOOR = floor_of(0)
"""The floor of the first map."""

ONTOLOGY = """
ontology: faults
relations:
  isBehind: {joins: [Shelf, Door], functional: true}
  isReservedFor: {joins: [Table, Graspable]}
types:
  Parcel: {parent: Graspable, defaults: {Shape.Form: Box, Shape.Width: 0.1, Shape.Depth: 0.1, Shape.Height: 0.1}}
services:
  CarryParcel:
    inputs: {Object: Graspable, Place: Support}
    precondition: "?Object isOn ?Source AND ?Object.Weight <= ?Provider.Payload"
    effect: "?Object isOn ?Place"
  WeighObject:
    kind: cognitive
    inputs: {Object: Graspable}
    outputs: {Weight: number}
    effect: "?Object.Weight = ?Weight"
  ReserveTable:
    kind: software
    inputs: {Object: Graspable}
    outputs: {Table: Table}
    effect: "?Table isReservedFor ?Object"
  CarryObject:
    inputs: {Object: Graspable, Table: Table}
    precondition: "?Object isOn ?Source"
    effect: "?Object isOn ?Table"
  StoreObject:
    inputs: {Object: Graspable, Shelf: Shelf}
    precondition: "?Object isOn ?Source AND ?Shelf isBehind ?Door AND ?Door.Open = TRUE"
    effect: "?Object isOn ?Shelf"
  StoreFreely:
    inputs: {Object: Graspable, Shelf: Shelf}
    precondition: "?Object isOn ?Source"
    effect: "?Object isOn ?Shelf"
  StoreThrough:
    inputs: {Object: Graspable, Shelf: Shelf, Door: Door}
    precondition: "?Object isOn ?Source AND ?Shelf isBehind ?Door"
    while: "?Door.Open = TRUE"
    effect: "?Object isOn ?Shelf"
  UnlockDoor:
    inputs: {Door: Door}
    precondition: "?Door.Open = FALSE"
    effect: "?Door.Open = TRUE"
  LockDoor:
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

RECOGNITION = "RecognizeSituation"

WEIGHING = "WeighObject"

RESERVATION = "ReserveTable"

TELLING = (RECOGNITION, WEIGHING, RESERVATION)
"""The services that move nothing: they find out, or compute."""

SERVICES: dict[Setting, tuple[tuple[str, ...], ...]] = {
    Setting.FLAT: (("TransferObject",),),
    Setting.DOORS: (("CarryObject",), ("StoreObject",), ("UnlockDoor", "LockDoor"), ("CarryObject", "StoreObject")),
    Setting.GRIP: (("PickUp", "PutDown"),),
}
"""The services of a setting's devices, in turn, so that some device offers each service. `Store` and `Carry` have alternatives."""


@cache
def ontology() -> Ontology:
    return load_text(ONTOLOGY, "faults", base=upper()).ontology


@cache
def service_type(name: str) -> ServiceType:
    return ontology().services[name]


def homes_of(scenario: Scenario) -> dict[str, str]:
    """The map of each object at the start. A shelf is where its door is, and a thing where it stands."""
    floors = map(floor_of, range(scenario.repositories))
    numbered = (*floors, *scenario.tables, *(door for door, _ in scenario.doors), *(device.name for device in scenario.devices))
    homes = {name: scenario.maps[scenario.map_number(name)] for name in numbered}
    homes |= {shelf: homes[door] for shelf, door in scenario.shelves}
    return homes | {thing: homes[place] for thing, place in scenario.things}


def map_of(scenario: Scenario, home: str) -> Map:
    """Return the map with this name at the start, with its devices on it."""
    homes = homes_of(scenario)

    def is_here(name: str) -> bool:
        return homes.get(name, home) == home

    objects = (object for object in _objects(scenario) if is_here(object.name))
    return Map(objects, (fact for fact in _facts(scenario) if all(map(is_here, fact.arguments))), home)


def _objects(scenario: Scenario) -> Iterator[Object]:
    def placed(name: str, type: str, **extra_values: Value) -> Object:
        box: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": 1.0, "Shape.Depth": 1.0, "Shape.Height": 0.8}
        return Object(name=name, type=type, values={"PositionX": 1.0, "PositionY": 1.0, "PositionZ": 0.0, **box, **extra_values})

    yield Object(name="Building1", type="Building")
    yield Object(name="Storey1", type="Storey")
    yield from (placed(floor_of(number), "Floor") for number in range(scenario.repositories))
    yield from (placed(table, "Table") for table in scenario.tables)
    yield from (placed(shelf, "Shelf") for shelf, _ in scenario.shelves)
    yield from (placed(door, "Door", Open=is_open) for door, is_open in scenario.doors)
    yield from (placed(thing, scenario.thing_type, Texture=looks_of(thing)) for thing, _ in scenario.things)
    yield from (placed(device.name, "PioneerP3DX", Payload=device.payload) for device in scenario.devices)


def looks_of(thing: str) -> str:
    """The texture of a thing, by which cameras recognise it: no other thing has the same."""
    return f"as of {thing}"


def _facts(scenario: Scenario) -> Iterator[Fact]:
    yield Fact(PART_OF, ("Storey1", "Building1"))
    floors = map(floor_of, range(scenario.repositories))
    standing = [
        *floors,
        *scenario.tables,
        *(s for s, _ in scenario.shelves),
        *(d for d, _ in scenario.doors),
        *(t for t, _ in scenario.things),
    ]
    yield from (Fact(PART_OF, (name, "Storey1")) for name in [*standing, *(device.name for device in scenario.devices)])
    yield from (Fact("isBehind", (shelf, door)) for shelf, door in scenario.shelves)
    yield from (Fact("isOn", (thing, place)) for thing, place in scenario.things)

"""Two rooms with a door between them, for the simulator's tests."""

from __future__ import annotations

from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Value
from tests.support.simulator_room import Start, box, robot, shell

DOOR = "Door1"


def two_rooms(*starts: Start, type: str = "AutomaticDoor", extra: tuple[Object, ...] = (), **values: Value) -> Map:
    """Two rooms with a door between them."""
    walls = [box("WallA", "Wall", (4, 1.1, 0), (0.1, 2.2, 2.5)), box("WallB", "Wall", (4, 4.8, 0), (0.1, 2.4, 2.5))]
    door = box(DOOR, type, (4, 2.9, 0), (0.1, 1.4, 2.1), **values)
    robots = [robot(f"Robot{number}", start) for number, start in enumerate(starts, start=1)]
    return Map([*shell(), *walls, door, *robots, *extra])

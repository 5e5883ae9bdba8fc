"""How long planning takes, by the size of the map and the length of the plan: `python benchmarks/planning.py`."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator

from somrs.app.engines import driver, fast_downward
from somrs.entish.parse import parse
from somrs.ontology.files import upper
from somrs.ontology.objects import Fact, Map, Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import AttributeType, Kind, ObjectType, Ontology, RelationType
from somrs.planner.plan import NoPlan
from somrs.planner.planning import plan
from somrs.planner.problem import Available, Problem

RUNS = 3

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
    precondition="?Provider isInside ?From AND leads(?Door, ?From, ?To) AND ?Door.Open = TRUE",
    effect="?Provider isInside ?To",
)
ONTOLOGY: Ontology = upper().extended(
    [
        AttributeType(name="Clean", kind=Kind.TRUTH),
        ObjectType(name="Jar", parent="Graspable", attributes=("Clean",)),
        ObjectType(name="Washer", parent="StationaryDevice"),
        RelationType(name="isInside", joins=("Device", "Space"), functional=True),
        RelationType(name="leads", joins=("Passage", "Space", "Space")),
    ]
)


def store(size: int) -> Map:
    """Half jars, half shelves, ten washers."""
    jars = [Object(name=f"Jar{n}", type="Jar") for n in range(size // 2)]
    shelves = [Object(name=f"Shelf{n}", type="Shelf") for n in range(size // 2)]
    washers = [Object(name=f"Washer{n}", type="Washer") for n in range(10)]
    return Map([*jars, *shelves, *washers], [Fact("isOn", (f"Jar{n}", f"Shelf{n % 100}")) for n in range(size // 2)])


def corridor(length: int) -> Map:
    """Rooms in a row, all doors shut, a robot in the first room."""
    rooms = [Object(name=f"Room{n}", type="Room") for n in range(length)]
    doors = [Object(name=f"Door{n}", type="Door", values={"Open": False}) for n in range(length - 1)]
    ways = [Fact("leads", (f"Door{n}", f"Room{a}", f"Room{b}")) for n in range(length - 1) for a, b in ((n, n + 1), (n + 1, n))]
    return Map([*rooms, *doors, Object(name="Robot1", type="MobileRobot")], [Fact("isInside", ("Robot1", "Room0")), *ways])


def problem(map: Map, goal: str, *services: ServiceType) -> Problem:
    washers = tuple(f"Washer{n}" for n in range(10))
    offered = tuple(Available(service, washers if service is WASH else ("Robot1",)) for service in services)
    return Problem(ontology=ONTOLOGY, map=map, goal=parse(goal), services=offered)


def problems() -> Iterator[tuple[str, Problem]]:
    for size in (50, 5_000, 20_000):
        yield f"a jar to a shelf, {size} objects", problem(store(size), "Jar7 isOn Shelf9", TRANSFER)
        yield f"a jar washed, {size} objects", problem(store(size), "Jar7.Clean = TRUE AND Jar7 isOn Shelf9", TRANSFER, WASH)
    ten = " AND ".join(f"Jar{n}.Clean = TRUE AND Jar{n} isOn Shelf99" for n in range(10))
    yield "ten jars washed, 5000 objects", problem(store(5_000), ten, TRANSFER, WASH)
    yield "whatever is on a shelf taken off it, 5000 objects", problem(store(5_000), "NOT ?x isOn Shelf9", TRANSFER)
    yield "what nobody can do, 5000 objects", problem(store(5_000), "Shelf1 isOn Shelf2", TRANSFER, WASH)
    for length in (10, 50, 200):
        yield f"through {length} rooms", problem(corridor(length), f"Robot1 isInside Room{length - 1}", DRIVE, OPEN)


def main() -> None:
    engine = fast_downward if driver() is not None else None
    first = 0.0
    print(f"{'':55} {'found':>10} {'median':>12} {'ratio':>8}")
    for name, asked in problems():
        times: list[float] = []
        for _ in range(RUNS):
            started = time.perf_counter()
            found = plan(asked, engine)
            times.append(time.perf_counter() - started)
        seconds = statistics.median(times)
        first = first or seconds
        outcome = "no plan" if isinstance(found, NoPlan) else f"{len(found.steps)} steps"
        print(f"{name:55} {outcome:>10} {seconds * 1000:9.1f} ms {seconds / first:8.1f}")


if __name__ == "__main__":
    main()

"""Measures planning by the size of the map, of the fleet and of the plan: `python benchmarks/planning.py`.

`python benchmarks/planning.py fleet` measures only by the size of the fleet.
`python benchmarks/planning.py somrs 10000 five` runs one measurement, in a process that measures its own memory.
"""

from __future__ import annotations

import gc
import importlib.util
import json
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial

from building import PLACES, delivery_problem
from contestants import unified
from msgspec.structs import replace
from timing import format_time

from somrs.deployment.programs import YOUNG_OBJECTS
from somrs.entish.parse import parse
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, FactAdded, FactRemoved, Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import AttributeType, Kind, ObjectType, Ontology, RelationType
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner.planning import plan
from somrs.planner_service.engines import driver, plan_in_process

RUNS = 3
SIZES = (50, 100, 1_000, 10_000, 100_000)
FLEETS = (10, 100, 1_000)
PATIENCE = 60.0
"""Seconds after which a contestant is stopped."""
MEGABYTE = 1024
"""Kilobytes, the unit in which Linux reports memory."""

ONE_STEP_GOAL = "Jar7 isOn Shelf9"
FIVE_STEP_GOAL = "Jar7.Clean = TRUE AND Jar7 isOn Shelf9 AND Jar8.Clean = TRUE"

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
    """Return a map of half jars, half shelves, and ten washers."""
    jars = [Object(name=f"Jar{n}", type="Jar") for n in range(size // 2)]
    shelves = [Object(name=f"Shelf{n}", type="Shelf") for n in range(size // 2)]
    washers = [Object(name=f"Washer{n}", type="Washer") for n in range(10)]
    return Map([*jars, *shelves, *washers], [Fact("isOn", (f"Jar{n}", f"Shelf{n % 100}")) for n in range(size // 2)])


def corridor(length: int) -> Map:
    """Return a map of rooms in a row with closed doors, and a robot in the first room."""
    rooms = [Object(name=f"Room{n}", type="Room") for n in range(length)]
    doors = [Object(name=f"Door{n}", type="Door", values={"Open": False}) for n in range(length - 1)]
    ways = [
        Fact("leads", (f"Door{n}", f"Room{room}", f"Room{next_room}"))
        for n in range(length - 1)
        for room, next_room in ((n, n + 1), (n + 1, n))
    ]
    return Map([*rooms, *doors, Object(name="Robot1", type="MobileRobot")], [Fact("isInside", ("Robot1", "Room0")), *ways])


def problem(map: Map, goal: str, *services: ServiceType) -> Problem:
    washers = tuple(f"Washer{n}" for n in range(10))
    offered = tuple(AvailableService(service, washers if service is WASH else ("Robot1",)) for service in services)
    return Problem(ontology=ONTOLOGY, map=map, goal=parse(goal), services=offered)


def problems() -> Iterator[tuple[str, Problem]]:
    for size in (50, 5_000, 20_000):
        yield f"a jar to a shelf, {size} objects", problem(store(size), "Jar7 isOn Shelf9", TRANSFER)
        yield f"a jar washed, {size} objects", problem(store(size), "Jar7.Clean = TRUE AND Jar7 isOn Shelf9", TRANSFER, WASH)
    ten = " AND ".join(f"Jar{n}.Clean = TRUE AND Jar{n} isOn Shelf99" for n in range(10))
    yield "ten jars washed, 5000 objects", problem(store(5_000), ten, TRANSFER, WASH)
    yield "whatever is on a shelf taken off it, 5000 objects", problem(store(5_000), "NOT ?x isOn Shelf9", TRANSFER)
    yield "a goal out of reach, 5000 objects", problem(store(5_000), "Shelf1 isOn Shelf2", TRANSFER, WASH)
    for length in (10, 50, 200):
        yield f"through {length} rooms", problem(corridor(length), f"Robot1 isInside Room{length - 1}", DRIVE, OPEN)


def measure(contestant: str, size: int, task: str) -> dict[str, float] | None:
    """Return the seconds to the first plan, and to the same task after a jar was moved, and the memory in megabytes; None without a plan
    in time."""
    current_problem = problem(store(size), ONE_STEP_GOAL if task == "one" else FIVE_STEP_GOAL, TRANSFER, WASH)
    gc.set_threshold(YOUNG_OBJECTS)  # as in the programs that plan
    memory_before = _memory()
    plan_lengths: list[int | None] = []
    if contestant == "unified-planning":
        goal = (
            unified.unified_task(current_problem, (), {"Jar7": "Shelf9"})
            if task == "one"
            else unified.unified_task(current_problem, ("Jar7", "Jar8"), {"Jar7": "Shelf9"})
        )
        first = _seconds(lambda: plan_lengths.append(unified.steps(goal, PATIENCE)))
        if plan_lengths == [None]:
            return None
        return {"first": first, "again": first, "memory": _memory() - memory_before}
    first = _seconds(lambda: plan(current_problem))
    repeat_times = []
    for number in range(20, 20 + 5):
        old_fact, new_fact = Fact("isOn", (f"Jar{number}", f"Shelf{number}")), Fact("isOn", (f"Jar{number}", "Shelf1"))
        moved = current_problem.map.changed([FactRemoved(old_fact), FactAdded(new_fact)])
        current_problem = replace(current_problem, map=moved)
        repeat_times.append(_seconds(partial(plan, current_problem)))
    return {"first": first, "again": statistics.median(repeat_times), "memory": _memory() - memory_before}


def _seconds(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def _processor_seconds(work: Callable[[], object]) -> float:
    """Return the processor time of work in this process alone, which a busy machine hardly changes."""
    started = time.process_time()
    work()
    return time.process_time() - started


def _memory() -> float:
    """Return the peak memory of this process and its children, in megabytes."""
    kilobytes = max(resource.getrusage(owner).ru_maxrss for owner in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return kilobytes / MEGABYTE


def measure_in_process(contestant: str, size: int, task: str) -> dict[str, float] | None:
    """Run the measurement in a separate process; None if it took too much time or memory."""
    command = [sys.executable, __file__, contestant, str(size), task]
    try:
        completed = subprocess.run(command, stdout=subprocess.PIPE, text=True, timeout=2 * PATIENCE, check=True)
    except subprocess.TimeoutExpired:
        return None
    result: dict[str, float] | None = json.loads(completed.stdout.splitlines()[-1])
    return result


def by_size() -> None:
    """Print time and memory by the size of the map, and those of a planner without an analysis of relevance."""
    rivals = importlib.util.find_spec("unified_planning") is not None and driver() is not None
    contestants = ["somrs", *(["unified-planning"] if rivals else [])]
    print(f"{'':26} {'objects':>8} {'first plan':>12} {'the next':>12} {'memory':>10}")
    for task, label in (("one", "one step"), ("five", "five steps")):
        for contestant in contestants:
            for size in SIZES:
                result = measure_in_process(contestant, size, task)
                if result is None:
                    print(f"{label + ', ' + contestant:28} {size:6} {'none within ' + format(PATIENCE, '.0f') + ' s':>25}", flush=True)
                    break
                times = f"{format_time(result['first']):>12} {format_time(result['again']):>12}"
                print(f"{label + ', ' + contestant:28} {size:6} {times} {result['memory']:7.0f} MB", flush=True)
    if not rivals:
        print("without unified-planning and Fast Downward; pip install -e '.[planner,rivals]' installs them")


def main() -> None:
    by_size()
    print()
    by_fleet()
    print()
    by_length()


def by_fleet() -> None:
    """Print the processor time to plan deliveries across storeys, by the number of robots that could make them."""
    print(f"{'':55} {'found':>10} {'first plan':>12} {'median':>12} {'robots':>7}")
    for deliveries, label in ((1, "one delivery"), (30, "thirty deliveries")):
        for robots in FLEETS:
            current_problem = delivery_problem(robots, deliveries)
            times = [_processor_seconds(partial(plan, current_problem)) for _ in range(RUNS)]
            result = plan(current_problem)
            assert isinstance(result, Plan), result
            name = f"{label}, {robots} robots, {PLACES} places"
            at_work = len({step.provider for step in result.steps})
            times_text = f"{format_time(times[0]):>12} {format_time(statistics.median(times)):>12}"
            print(f"{name:55} {len(result.steps):4} steps {times_text} {at_work:7}", flush=True)


def by_length() -> None:
    first = 0.0
    print(f"{'':55} {'found':>10} {'median':>12} {'ratio':>8}")
    for name, current_problem in problems():
        times: list[float] = []
        for _ in range(RUNS):
            started = time.perf_counter()
            result = plan_in_process(current_problem)
            times.append(time.perf_counter() - started)
        seconds = statistics.median(times)
        first = first or seconds
        outcome = "no plan" if isinstance(result, NoPlan) else f"{len(result.steps)} steps"
        print(f"{name:55} {outcome:>10} {seconds * 1000:9.1f} ms {seconds / first:8.1f}")


if __name__ == "__main__":
    if sys.argv[1:] == ["fleet"]:
        by_fleet()
    elif len(sys.argv) > 1:
        print(json.dumps(measure(sys.argv[1], int(sys.argv[2]), sys.argv[3])))
    else:
        main()

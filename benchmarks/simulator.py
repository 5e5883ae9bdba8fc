"""Measures the speed of simulated time beside the bare physics of the same world, and paths through an office beside a search in C.

Run it as `python benchmarks/simulator.py [office.building.yaml]`.
"""

from __future__ import annotations

import asyncio
import math
import statistics
import sys
import time
from collections.abc import Callable
from importlib import resources
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from timing import side_by_side

from somrs.devices.simulator.link.commands import Command, CommandDone, CommandGivenUp, DriveTo, Grip, Place
from somrs.devices.simulator.server.server import Server
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.physics import PhysicsScene
from somrs.ontology.files.loading import load, upper
from somrs.ontology.objects import Map, Object
from somrs.ontology.types import Ontology, Value
from somrs.sites.openrmf import import_building
from somrs.space.navigation import Navigator
from somrs.space.solids import path_length

OFFICE = Path(__file__).parents[2] / "shared" / "sites" / "office.building.yaml"
ROUNDS = 3
RADIUS = 0.25
Jobs = dict[str, tuple[Command, ...]]
Box = tuple[float, float, float, float]

CARRY: Jobs = {
    "Robot1": (Grip(object="Jar002"), Place(support="Platform001")),
    "Robot2": (DriveTo(x=2.0, y=6.9), DriveTo(x=10.6, y=4.0)),
}
DELIVER: Jobs = {
    "tinyRobot1": (DriveTo(x=19.0, y=-6.2), DriveTo(x=10.4, y=-5.5)),
    "tinyRobot2": (DriveTo(x=7.0, y=-5.2), DriveTo(x=20.4, y=-5.3)),
}


def work(simulation: Simulation, jobs: Jobs) -> None:
    """Step the simulation until the robots have done their jobs."""
    open_jobs = {robot: list(commands) for robot, commands in jobs.items()}

    def run_next(robot: str, end: CommandDone | CommandGivenUp | None = None) -> None:
        if isinstance(end, CommandGivenUp):
            raise SystemExit(f"{robot} gave up: {end.description}")
        if open_jobs[robot]:
            simulation.command(robot, open_jobs[robot].pop(0), lambda end: run_next(robot, end))

    for robot in jobs:
        run_next(robot)
    while simulation.busy:
        simulation.step()


def pace(title: str, map: Map, ontology: Ontology, jobs: Jobs) -> None:
    """Print the simulated seconds per second of wall-clock time."""
    setup_times, whole, bare = [], [], []
    simulated = 0.0
    for _ in range(ROUNDS):
        started = time.perf_counter()
        simulation = Simulation(map, ontology)
        setup_times.append(time.perf_counter() - started)
        work(simulation, jobs)
        whole.append(time.perf_counter() - started - setup_times[-1])
        simulated = simulation.time
        scene = PhysicsScene(map, ontology)
        started = time.perf_counter()
        scene.step(round(simulated / scene.period))
        bare.append(time.perf_counter() - started)
    rates = [simulated / statistics.median(times) for times in (bare, whole)]
    print(
        f"\n{title}: {len(map.objects)} objects, {simulated:.0f} s of simulated time; "
        f"the world is made in {statistics.median(setup_times):.2f} s"
    )
    print(f"  {'bare physics':46} {rates[0]:6.0f} times real time")
    print(f"  {'robots at work':46} {rates[1]:6.0f} times real time, {rates[0] / rates[1]:.2f} times the cost of the bare physics")


def scenario() -> tuple[Map, Ontology]:
    with resources.as_file(resources.files("somrs.demo") / "data" / "scenario-1.yaml") as file:
        loaded = load([file])
    assert loaded.map is not None, "the scenario's site has a map"
    return loaded.map, loaded.ontology


def rest(map: Map, ontology: Ontology) -> None:
    """Print the CPU share of a simulator in which nothing moves."""

    async def measure_cpu() -> float:
        server = Server(Simulation(map, ontology), speed=None)
        await server.start()
        await asyncio.sleep(0.2)
        cpu_before = time.process_time()
        await asyncio.sleep(2)
        spent = time.process_time() - cpu_before
        await server.stop()
        return spent / 2

    print(f"  {'nothing moves':46} {asyncio.run(measure_cpu()):6.1%} of a core")


def office_boxes() -> dict[str, tuple[str, Box, float]]:
    """Return an office of 45 x 25 m, with a corridor and twelve rooms with desks: type, center and size, and height of each object."""
    boxes: dict[str, tuple[str, Box, float]] = {}
    for row, (low, high) in enumerate(((0, 11), (14, 25))):
        for i in range(12):
            x, inner = 45 / 12 * i, high if row == 0 else low
            boxes[f"Wall{row}{i}"] = ("Wall", (x, (low + high) / 2, 0.1, 11), 2.5)
            boxes[f"Front{row}{i}"] = ("Wall", (x + 1.4, inner, 2.8, 0.1), 2.5)
            for j in range(5):
                boxes[f"Desk{row}{i}{j}"] = ("Table", (x + 2, low + 1.5 + 2 * j, 1.6, 0.8), 0.7)
    return boxes


def box(name: str, type: str, place: Box, height: float, z: float = 0.0) -> Object:
    x, y, width, depth = place
    values: dict[str, Value] = {"PositionX": x, "PositionY": y, "PositionZ": z, "Shape.Form": "Box"}
    return Object(name=name, type=type, values={**values, "Shape.Width": width, "Shape.Depth": depth, "Shape.Height": height})


def grid_search(boxes: dict[str, tuple[str, Box, float]], cell: float = 0.1) -> Callable[[tuple[float, float], tuple[float, float]], float]:
    """Return a function that runs Dijkstra's algorithm in C on a prepared grid of the cells that are free for the robot."""
    xs, ys = np.meshgrid(np.arange(0, 45 + cell / 2, cell), np.arange(0, 25 + cell / 2, cell), indexing="ij")
    free = (np.minimum(xs, 45 - xs) >= RADIUS) & (np.minimum(ys, 25 - ys) >= RADIUS)
    for _, (x, y, width, depth), _ in boxes.values():
        free &= np.hypot(np.maximum(abs(xs - x) - width / 2, 0), np.maximum(abs(ys - y) - depth / 2, 0)) >= RADIUS
    numbers = np.arange(free.size).reshape(free.shape)
    starts, ends, costs = [], [], []
    for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
        source_slice = (slice(0, free.shape[0] - dx), slice(max(0, -dy), free.shape[1] - max(0, dy)))
        target_slice = (slice(dx, None), slice(max(0, dy), free.shape[1] - max(0, -dy)))
        free_pairs = free[source_slice] & free[target_slice]
        starts.append(numbers[source_slice][free_pairs])
        ends.append(numbers[target_slice][free_pairs])
        costs.append(np.full(free_pairs.sum(), cell * math.hypot(dx, dy)))
    edges = (np.concatenate(costs), (np.concatenate(starts), np.concatenate(ends)))
    graph = coo_array(edges, shape=(free.size, free.size)).tocsr()

    def search(start: tuple[float, float], goal: tuple[float, float]) -> float:
        begin, end = (numbers[round(x / cell), round(y / cell)] for x, y in (start, goal))
        return float(dijkstra(graph, directed=False, indices=begin)[end])

    return search


def navigation() -> None:
    boxes = office_boxes()
    objects = [box("Floor1", "Floor", (22.5, 12.5, 45, 25), 0.1, -0.1), *(box(name, *arguments) for name, arguments in boxes.items())]
    map, ontology = Map(objects), upper()
    search, navigator = grid_search(boxes), Navigator(map, ontology)
    start, goal = (1.0, 0.7), (44.5, 24.3)
    path = navigator.path(start, goal, RADIUS)
    assert path is not None
    length, plain = path_length(path), search(start, goal)
    print(f"\nan office of 45 x 25 m, {len(objects)} objects: a path of {length:.1f} m, on the grid {plain:.1f} m")
    ways: dict[str, Callable[[], object]] = {
        "scipy's Dijkstra on a prepared grid of 10 cm": lambda: search(start, goal),
        "path: found, smoothed, with a margin": lambda: navigator.path(start, goal, RADIUS),
        "Navigator: the map is read": lambda: Navigator(map, ontology),
        "both together": lambda: Navigator(map, ontology).path(start, goal, RADIUS),
    }
    side_by_side("finding paths", ways, rounds=5)


def main() -> None:
    map, ontology = scenario()
    pace("Scenario 1", map, ontology, CARRY)
    rest(map, ontology)
    office = Path(sys.argv[1]) if len(sys.argv) > 1 else OFFICE
    if office.exists():
        site = import_building(office)
        pace("the office of Open-RMF's demos", site.map, site.ontology, DELIVER)
    else:
        print(f"\nno office: there is no {office}; give the path of Open-RMF's office.building.yaml")
    navigation()


if __name__ == "__main__":
    main()

"""Measures what the driving distances for a quote cost in large buildings, beside a search for each robot on a grid.

Run it as `python benchmarks/quotes.py [building.yaml]`; without a building, it takes Open-RMF's airport, if that is there.
"""

from __future__ import annotations

import math
import random
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from itertools import cycle
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from timing import format_time, side_by_side

from somrs.devices.simulator.server.driving_distances import find_legs
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Ontology, Value
from somrs.sites.openrmf import import_building
from somrs.space.free_space import FreeSpace
from somrs.space.solids import Point, Role

AIRPORT = Path(__file__).parents[2] / "shared" / "sites" / "airport_terminal.building.yaml"
LENGTH, DEPTH = 280.0, 64.0
"""As large as an airport terminal, m."""
RADIUS = 0.22
ROBOTS = 10
TABLES = 40
"""The number of tables for which each robot makes a quote."""


def box(name: str, type: str, x: float, y: float, z: float, width: float, depth: float, height: float) -> Object:
    shape: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": width, "Shape.Depth": depth, "Shape.Height": height}
    return Object(name=name, type=type, values={"PositionX": x, "PositionY": y, "PositionZ": z, **shape})


def hall() -> Map:
    """A hall with walls across it that leave a way of 4 m along one side, with tables between them, and robots."""
    objects = [box("Floor1", "Floor", LENGTH / 2, DEPTH / 2, -0.1, LENGTH, DEPTH, 0.1)]
    for number in range(1, 14):
        objects.append(box(f"Wall{number}", "Wall", number * 20.0, DEPTH / 2 + 2.0, 0.0, 0.2, DEPTH - 4, 3.0))
    for number in range(200):
        objects.append(box(f"Table{number}", "Table", 5.0 + number // 14 * 20, 4.0 + number % 14 * 4, 0.0, 1.2, 0.8, 0.75))
    rng = random.Random(1)
    for number in range(ROBOTS):
        position: dict[str, Value] = {"PositionX": 10.0 + 20 * rng.randrange(13), "PositionY": rng.uniform(3, DEPTH - 3), "PositionZ": 0.0}
        shape: dict[str, Value] = {"Shape.Form": "Cylinder", "Shape.Radius": RADIUS, "Shape.Height": 0.25}
        objects.append(Object(name=f"Robot{number}", type="MobileRobot", values={**position, **shape}))
    return Map(objects)


def measure(title: str, map: Map, ontology: Ontology) -> None:
    """Print what the first and all further quotes cost."""
    begin = time.process_time()
    simulation = Simulation(map, ontology, WorldKind.KINEMATIC)
    print(f"\n{title}: {len(map.objects)} objects; the world with its roadmap is made in {format_time(time.process_time() - begin)}")
    solids = simulation.scene.world.solids
    tables = sorted(solid.name for solid in solids.values() if solid.role is Role.SUPPORT)
    stops = [*zip(tables, random.Random(1).sample(tables, len(tables)), strict=True)][:TABLES]
    first: list[float] = []
    further: list[float] = []
    for pair in stops:
        for number, robot in enumerate(simulation.robots):
            begin = time.process_time()
            find_legs(simulation, robot, pair)
            (further if number else first).append(time.process_time() - begin)
    for who, times in (("the first robot that is asked for two tables", first), ("each further robot", further)):
        quantiles = f"median {format_time(statistics.median(times))}, worst {format_time(max(times))}"
        print(f"  {who:46} {quantiles} of CPU time, {len(times)} quotes")
    questions: Iterator[tuple[str, tuple[str, str]]] = cycle([(robot, pair) for pair in stops for robot in simulation.robots])
    space = FreeSpace(map, ontology)
    search = grid_search(space)
    positions = {robot: simulation.robots[robot].pose()[:2] for robot in simulation.robots}

    def on_the_grid() -> None:
        robot, pair = next(questions)
        search(positions[robot], [(solids[name].x, solids[name].y) for name in pair])

    ways: dict[str, Callable[[], object]] = {
        "Dijkstra in C on a grid of 20 cm, without doors": on_the_grid,
        "quotes, all of a kind: known ways": lambda: find_legs(simulation, *next(questions)),
    }
    side_by_side("a quote for two legs", ways, rounds=3)


def grid_search(space: FreeSpace, step: int = 4) -> Callable[[Point, list[Point]], float]:
    """Return a function that runs Dijkstra's algorithm in C for each leg, on a prepared grid of the free cells and those around tables."""
    free = space.field[::step, ::step] >= -0.5
    numbers = np.arange(free.size).reshape(free.shape)
    starts, ends, costs = [], [], []
    for dr, dc in ((1, 0), (0, 1), (1, 1), (1, -1)):
        source_slice = (slice(0, free.shape[0] - dr), slice(max(0, -dc), free.shape[1] - max(0, dc)))
        target_slice = (slice(dr, None), slice(max(0, dc), free.shape[1] - max(0, -dc)))
        free_pairs = free[source_slice] & free[target_slice]
        starts.append(numbers[source_slice][free_pairs])
        ends.append(numbers[target_slice][free_pairs])
        costs.append(np.full(free_pairs.sum(), step * space.grid.size * math.hypot(dr, dc)))
    edges = (np.concatenate(costs), (np.concatenate(starts), np.concatenate(ends)))
    graph = coo_array(edges, shape=(free.size, free.size)).tocsr()

    def number(point: Point) -> int:
        row, column = space.grid.clipped(point)
        return int(numbers[row // step, column // step])

    def search(start: Point, goals: list[Point]) -> float:
        length = 0.0
        for goal in goals:
            length += float(dijkstra(graph, directed=False, indices=number(start))[number(goal)])
            start = goal
        return length

    return search


def main() -> None:
    measure(f"a hall of {LENGTH:.0f} m by {DEPTH:.0f} m", hall(), upper())
    building = Path(sys.argv[1]) if len(sys.argv) > 1 else AIRPORT
    if building.exists():
        site = import_building(building)
        measure(building.name, site.map, site.ontology)
    else:
        print(f"\nno airport: there is no {building}; give the path of a building of Open-RMF's")


if __name__ == "__main__":
    main()

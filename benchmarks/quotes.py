"""Measures what the driving distances for a quote cost on the grid of a large hall.

Run it as `python benchmarks/quotes.py`.
"""

from __future__ import annotations

import random
import time
from collections.abc import Iterator
from itertools import count, repeat

from timing import format_time, side_by_side

from somrs.ontology.files.loading import upper
from somrs.ontology.objects import Map, Object
from somrs.ontology.types import Value
from somrs.space.navigation import Navigator

LENGTH, DEPTH = 280.0, 64.0
"""As large as an airport terminal, m."""
RADIUS = 0.3
REACH = (0.36, 0.64)
ROBOTS = 10


def box(name: str, type: str, x: float, y: float, z: float, width: float, depth: float, height: float) -> Object:
    shape: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": width, "Shape.Depth": depth, "Shape.Height": height}
    return Object(name=name, type=type, values={"PositionX": x, "PositionY": y, "PositionZ": z, **shape})


def hall() -> Map:
    """A hall with walls across it that leave a way of 4 m along one side, and with tables between them."""
    objects = [box("Floor1", "Floor", LENGTH / 2, DEPTH / 2, -0.1, LENGTH, DEPTH, 0.1)]
    for number in range(1, 14):
        objects.append(box(f"Wall{number}", "Wall", number * 20.0, DEPTH / 2 + 2.0, 0.0, 0.2, DEPTH - 4, 3.0))
    for number in range(200):
        objects.append(box(f"Table{number}", "Table", 5.0 + number // 14 * 20, 4.0 + number % 14 * 4, 0.0, 1.2, 0.8, 0.75))
    return Map(objects)


def main() -> None:
    map, ontology = hall(), upper()
    begin = time.process_time()
    navigator = Navigator(map, ontology)
    print(f"the grid of {navigator.grid.rows * navigator.grid.columns:,} cells: {format_time(time.process_time() - begin)} of CPU time")
    rng = random.Random(1)
    starts = [(10.0 + 20 * rng.randrange(13), rng.uniform(3, DEPTH - 3)) for _ in range(ROBOTS)]
    table = navigator.solids["Table100"]

    def quotes(radii: Iterator[float]) -> None:
        """The way of each robot to a table."""
        for start, radius in zip(starts, radii, strict=False):
            pose = navigator.approach_support(start, table, radius, REACH, limit=1)[0]
            assert navigator.path(start, (pose.x, pose.y), radius) is not None

    new_radii = (RADIUS + 1e-6 * number for number in count(1))
    ways = {
        "robots of one radius": lambda: quotes(repeat(RADIUS)),
        "a radius that nobody asked for: nothing is kept": lambda: quotes(new_radii),
    }
    side_by_side(f"the ways of {ROBOTS} robots to a table", ways, rounds=2)


if __name__ == "__main__":
    main()

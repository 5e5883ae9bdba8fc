"""Measures how many robots the simulator moves in real time on one core, in both kinds of worlds: `python benchmarks/worlds.py
[physics|kinematic] [N ...]`.

Robots stand in a hall, 3 m apart, between pillars. Each drives to and fro between its place and the free floor beside it, without a pause,
so that all of them move all the time. CPU time is that of the simulation alone, without sockets.
"""

from __future__ import annotations

import math
import os
import random
import resource
import subprocess
import sys
import time

from somrs.devices.simulator.link.commands import CommandDone, CommandGivenUp, DriveTo
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Value

NUMBERS = (10, 50, 100, 500, 1000)
CPU_TIME = 10.0
"""Seconds of CPU time after which a measurement ends."""
SIMULATED_TIME = 30.0
"""Simulated seconds after which a measurement ends."""
SPACING = 3.0
"""Distance between the places of two robots, m."""
TYPES = {"without arm": "PatrolRobot", "with arm": "PioneerP3DX"}


def box(name: str, type: str, place: tuple[float, float, float], size: tuple[float, float, float]) -> Object:
    values: dict[str, Value] = {"PositionX": place[0], "PositionY": place[1], "PositionZ": place[2], "Shape.Form": "Box"}
    return Object(name=name, type=type, values={**values, "Shape.Width": size[0], "Shape.Depth": size[1], "Shape.Height": size[2]})


def hall(robots: int, type: str) -> Map:
    columns = math.ceil(math.sqrt(robots))
    side, chance = SPACING * (columns + 1), random.Random(1)
    pillars = [
        box(f"Pillar{row}_{column}", "Wall", (SPACING * (column + 1.5), SPACING * (row + 1.5), 0), (0.4, 0.4, 2.5))
        for row in range(0, columns, 3)
        for column in range(0, columns, 3)
    ]
    fleet = [
        Object(
            name=f"Robot{n}",
            type=type,
            values={
                "PositionX": SPACING * (n % columns + 1),
                "PositionY": SPACING * (n // columns + 1),
                "RotationZ": chance.uniform(-3, 3),
                "Speed": 0.8,
            },
        )
        for n in range(robots)
    ]
    return Map([box("Floor1", "Floor", (side / 2, side / 2, -0.1), (side, side, 0.1)), *pillars, *fleet])


class Shuttle:
    """Drives robots to and fro. `driven`: the number of drives that were completed."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._homes = {name: robot.pose()[:2] for name, robot in simulation.robots.items()}
        self._idle = [*simulation.robots]
        self._chance = random.Random(2)
        self._away = dict.fromkeys(simulation.robots, False)
        self.driven = 0

    def step(self) -> None:
        """Send every idle robot on, and advance by one control period."""
        idle, self._idle = self._idle, []
        for robot in idle:
            (x, y), angle = self._homes[robot], self._chance.uniform(0, math.tau)
            way = 0.0 if self._away[robot] else 1.0
            self._away[robot] = not self._away[robot]
            target = DriveTo(x=x + way * math.cos(angle), y=y + way * math.sin(angle))
            self._simulation.command(robot, target, lambda end, robot=robot: self._ended(robot, end))  # type: ignore[misc]
        self._simulation.step()

    def _ended(self, robot: str, end: CommandDone | CommandGivenUp) -> None:
        self.driven += isinstance(end, CommandDone)
        self._idle.append(robot)


def measure(kind: WorldKind, type: str, robots: int) -> None:
    """Print one row: how fast the time of the world passes on a core, and what the process needs of memory."""
    simulation = Simulation(hall(robots, type), upper(), kind)
    shuttle = Shuttle(simulation)
    shuttle.step()  # plans the first paths of all at once
    start_time, first = time.process_time(), simulation.time
    while (spent := time.process_time() - start_time) < CPU_TIME and simulation.time - first < SIMULATED_TIME:
        shuttle.step()
    ratio = (simulation.time - first) / spent
    megabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    drives = shuttle.driven / (simulation.time - first)
    print(f"  {robots:6} {ratio:18.1f} {1e6 / ratio / robots:16.0f} {drives:12.0f} {megabytes:10.0f}", flush=True)


def main() -> None:
    if len(sys.argv) == 4 and sys.argv[2] in TYPES.values():
        measure(WorldKind(sys.argv[1]), sys.argv[2], int(sys.argv[3]))
        return
    kinds = [kind for kind in WorldKind if kind in sys.argv[1:]] or list(WorldKind)
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()] or list(NUMBERS)
    for kind in kinds:
        for label, type in TYPES.items():
            print(f"\n{kind}, robots {label}")
            print(f"  {'robots':>6} {'times real time':>18} {'µs per robot, s':>16} {'drives a s':>12} {'MB':>10}", flush=True)
            for number in numbers:  # each in a process of its own, because of the memory
                subprocess.run([sys.executable, __file__, kind, type, str(number)], check=True, env={**os.environ, "PYTHONHASHSEED": "0"})


if __name__ == "__main__":
    main()

"""Measures the memory of the programs of a fleet's devices: all in a few processes as by default, and each in a process of its own.

The fleet stands in a hall. Memory is the proportional set size (Pss), which divides shared memory among the processes that share it. Run it
as `python benchmarks/fleet_memory.py [NUMBER_OF_ROBOTS ...]`.
"""

from __future__ import annotations

import asyncio
import sys
import tempfile
from pathlib import Path

from start import cpu, memory

from somrs.deployment.devices_of_map import devices
from somrs.deployment.system import System
from somrs.ontology.files.loading import load

SPACING = 1.5
"""Distance between two robots, m."""
ROW = 10
"""Robots in a row."""
REST = 20.0
"""Seconds for which the fleet stands before its memory is measured."""


def hall(robots: int) -> str:
    """The site of a hall with a number of robots."""
    width, depth = SPACING * (ROW + 1), SPACING * (robots // ROW + 2)
    middle = f"{width / 2}, {depth / 2}"
    lines = [
        "upper: 2",
        "map: Hall",
        "objects:",
        "  Room001:",
        "    type: Room",
        "    parts:",
        f"      Floor001: {{type: Floor, at: [{middle}, -0.1], Shape: {{Form: Box, Width: {width}, Depth: {depth}, Height: 0.1}}}}",
    ]
    for number in range(robots):
        x, y = SPACING * (number % ROW + 1), SPACING * (number // ROW + 1)
        lines.append(f"  Robot{number + 1:03}: {{type: PioneerP3DX, at: [{x}, {y}, 0], Price: 10 EUR, Charge: 100}}")
    return "\n".join(lines) + "\n"


async def measure(robots: int, devices_per_process: int | None) -> None:
    with tempfile.TemporaryDirectory() as folder:
        site = Path(folder) / "hall.yaml"
        site.write_text(hall(robots))
        loaded = load([site])
        assert loaded.map is not None, "the hall is a map"
        device_count = len(devices(loaded.map, loaded.ontology))
        async with System([site], Path(folder) / "run", devices_per_process=devices_per_process) as system:
            await asyncio.sleep(REST)
            core = {"repository", "registry", "task-manager", "simulator", "scheduler", "api"}
            processes = [program.process.pid for program in system.programs.values() if program.name not in core]
            total, spent = sum(map(memory, processes)), sum(map(cpu, processes))
            print(
                f"{device_count:4} robots in {len(processes):3} processes: {total:6.0f} MB, {total / device_count:5.1f} MB each; "
                f"{spent:5.1f} s of CPU so far",
                flush=True,
            )


def main() -> None:
    for robots in [int(argument) for argument in sys.argv[1:]] or [20, 100]:
        for devices_per_process in (1, None):
            asyncio.run(measure(robots, devices_per_process))


if __name__ == "__main__":
    main()

"""Measures the start of a system: CPU and memory of its programs, by `somrs up` with some of its options, and as separate processes,
in turns.

It starts the paper's scenario with its windows. CPU is that of each process until all are ready, from /proc; memory is the proportional set
size (Pss), which divides shared memory among the processes that share it. Run it as `python benchmarks/start.py`.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from somrs.deployment.launcher import Launcher, Process
from somrs.deployment.system import System

SITE = Path(__file__).parents[1] / "src" / "somrs" / "demo" / "data" / "scenario-1.yaml"


class Singly(Launcher):
    """Starts each program as a separate Python."""

    async def start(self, arguments: Sequence[str], log: Path, environment: Mapping[str, str]) -> Process:
        line = [sys.executable, "-m", "somrs.cli.main", *arguments]
        read, write = os.pipe()
        reader = asyncio.StreamReader()
        await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(read, "rb"))
        with log.open("ab") as errors:
            program = subprocess.Popen(line, stdin=subprocess.DEVNULL, stdout=write, stderr=errors, env={**environment})
        os.close(write)
        process = Process(program.pid, reader)
        self._waiting = [*getattr(self, "_waiting", []), asyncio.create_task(self._wait(program, process))]
        return process

    async def _wait(self, program: subprocess.Popen[bytes], process: Process) -> None:
        process.ended(await asyncio.to_thread(program.wait))


@dataclass(slots=True)
class Cost:
    wall: float
    cpu: float
    memory: float


def cpu(process: int) -> float:
    """Return the CPU seconds of the process."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(") ")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory(process: int) -> float:
    """Return the memory of the process in megabytes."""
    lines = Path(f"/proc/{process}/smaps_rollup").read_text().splitlines()
    return sum(int(line.split()[1]) for line in lines if line.startswith("Pss:")) / 1024


async def started_singly() -> Cost:
    """Start all programs of a system as separate Pythons; the cost excludes the program that starts them."""
    with tempfile.TemporaryDirectory() as folder:
        system = System([SITE], Path(folder), windows=True, launcher=Singly(), certificates=False)
        started_at = time.perf_counter()
        async with system:
            wall = time.perf_counter() - started_at
            return cost(wall, [program.process.pid for program in system.programs.values()])


def started_by_command(*options: str) -> Cost:
    """Start a system with `somrs up` and these options; the cost includes all its processes."""
    with tempfile.TemporaryDirectory() as folder:
        line = [sys.executable, "-m", "somrs.cli.main", "up", str(SITE), "--data", folder, *options]
        started_at = time.perf_counter()
        with subprocess.Popen(line, stdout=subprocess.PIPE, text=True) as program:
            assert program.stdout is not None
            for output_line in program.stdout:
                if "In the browser" in output_line:
                    break
            wall = time.perf_counter() - started_at
            total = cost(wall, [program.pid, *descendants(program.pid)])
            program.send_signal(signal.SIGINT)
            program.stdout.read()
        return total


def descendants(process: int) -> list[int]:
    """Return the children of a process, and their descendants."""
    children = [int(id) for id in Path(f"/proc/{process}/task/{process}/children").read_text().split()]
    return [*children, *(descendant for child in children for descendant in descendants(child))]


def cost(wall: float, processes: Sequence[int]) -> Cost:
    return Cost(wall, sum(map(cpu, processes)), sum(map(memory, processes)))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=5, help="number of rounds")
    rounds = parser.parse_args().rounds
    results: dict[str, list[Cost]] = {}
    for _ in range(rounds):
        for options in ((), ("--no-certificates",), ("--bus",), ("--bus", "--no-certificates")):
            results.setdefault(" ".join(("somrs up", *options)), []).append(started_by_command(*options))
        results.setdefault("each by itself, no certificates", []).append(asyncio.run(started_singly()))
    for name, costs in results.items():
        wall, spent, own_memory = (
            statistics.median(getattr(sample, attribute) for sample in costs) for attribute in ("wall", "cpu", "memory")
        )
        print(f"{name:34} {wall:5.1f} s, {spent:5.1f} s of CPU, {own_memory:5.0f} MB")


if __name__ == "__main__":
    main()

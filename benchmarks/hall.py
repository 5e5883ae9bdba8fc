"""Measures deliveries by many robots with a whole system: `python benchmarks/hall.py [burst|steady] [N ...]`.

A hall with tables has N robots and a jar for each. The system is started with `somrs up`, in the kinematic world, in real time, and without
windows. "burst": N deliveries are submitted at once, and the run ends when all have ended. "steady": N deliveries are open for minutes,
the next one is submitted when one has ended. Each goes to the robot that is done soonest: by price, the nearest ones would have more to do
than they can, while others stand idle.
"""

from __future__ import annotations

import asyncio
import math
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

from start import cpu, descendants, memory

from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.client.simulator_link import operator_link
from somrs.devices.simulator.link.link import OperatorLink
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Policy, Submit
from somrs.protocol.messages.task_news import WatchTasks

NUMBERS = (10, 25, 50, 100, 200)
SIDE = 24.0
"""The side of the hall for up to `CROWD` robots, m; more robots have as much room each."""
CROWD = 50
AISLE = 4.0
"""The distance between the middles of two tables, m."""
WARM_UP, STEADY = 60.0, 300.0
"""The simulated seconds of a steady run before it is measured, as all deliveries begin at once; and those that are measured."""
PATIENCE = 1800.0
"""The simulated seconds after which a burst ends that has not come to its end."""
SAMPLE = 2.0
"""The seconds between two looks at the robots."""
STILL = 0.02
"""A robot that drives has moved by more than this between two looks, or waits, m."""
DRIVING = {"Approach", "DriveTo", "Place", "LookAt", "Charge"}
"""The commands in which a robot drives."""


def tables_of(robots: int) -> list[tuple[float, float]]:
    """Where the tables of a hall stand."""
    side = side_of(robots)
    count = int(side // AISLE)
    return [((column + 0.5) * side / count, (row + 0.5) * side / count) for row in range(count) for column in range(count)]


def side_of(robots: int) -> float:
    return SIDE * math.sqrt(max(1.0, robots / CROWD))


def hall(robots: int) -> Iterator[str]:
    """The site of a hall: tables in rows, robots between them, and jars on the tables."""
    side, tables = side_of(robots), tables_of(robots)
    yield "upper: 2"
    yield "map: Hall"
    yield "objects:"
    yield "  Room001:"
    yield "    type: Room"
    yield "    parts:"
    shape = f"{{Form: Box, Width: {side}, Depth: {side}, Height: 0.1}}"
    yield f"      Floor001: {{type: Floor, at: [{side / 2}, {side / 2}, -0.1], Shape: {shape}}}"
    walls = (
        (side / 2, -0.05, side, 0.1),
        (side / 2, side + 0.05, side, 0.1),
        (-0.05, side / 2, 0.1, side),
        (side + 0.05, side / 2, 0.1, side),
    )
    for number, (x, y, width, depth) in enumerate(walls, start=1):
        yield f"      Wall{number:03}: {{type: Wall, at: [{x}, {y}, 0], Shape: {{Form: Box, Width: {width}, Depth: {depth}, Height: 2.5}}}}"
    for number, (x, y) in enumerate(tables, start=1):
        yield f"  Table{number:03}: {{type: Support, at: [{x}, {y}, 0], Shape: {{Form: Box, Width: 1.6, Depth: 0.8, Height: 0.74}}}}"
    columns = math.isqrt(len(tables))
    for number in range(robots):
        x, y = tables[number % len(tables)]
        step = 0.8 * (number // len(tables))
        yield (
            f"  Robot{number + 1:03}: {{type: PioneerP3DX, at: [{x - 0.8 + step:.3f}, {y - side / columns / 2 + 0.4:.3f}, 0], "
            "Price: 10 EUR, Charge: 100}"
        )
        jar = -0.6 + 0.3 * (number // len(tables))
        yield f"  Jar{number + 1:03}: {{type: Jar, at: [{x + jar:.3f}, {y - 0.3:.3f}, 0.74]}}"
    yield "facts:"
    for number in range(robots):
        yield f"  - Jar{number + 1:03} isOn Table{number % len(tables) + 1:03}"


@dataclass(slots=True)
class Run:
    """What is measured during a run. `looks`: robots that had a way to go, and those of them that stood still, at all looks together."""

    robots: int
    accomplished: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    began: float = 0.0
    ended: float = 0.0
    wall: float = 0.0
    driving: int = 0
    waiting: int = 0
    cpu: dict[str, float] = field(default_factory=dict)
    memory: float = 0.0
    explanations: Counter[str] = field(default_factory=Counter)
    until_begun: list[float] = field(default_factory=list)
    """The seconds from submission until a robot begins, of each delivery."""
    at_work: list[float] = field(default_factory=list)
    """The seconds from then on."""


class Deliveries:
    """Submits deliveries, each of a jar to a table where it is not."""

    def __init__(self, robots: int, client: Client) -> None:
        self._robots, self._client = robots, client
        self._tables = len(tables_of(robots))
        self._chance = random.Random(robots)
        self._places = {number: number % self._tables for number in range(robots)}

    async def submit(self, jar: int) -> str:
        table = self._chance.choice([table for table in range(self._tables) if table != self._places[jar]])
        self._places[jar] = table
        return await self._client.submit(Submit(effect=f"Jar{jar + 1:03} isOn Table{table + 1:03}", policy=Policy.TIME))


async def play(robots: int, addresses: Addresses, *, steady: bool) -> Run:
    """Play a burst, or a steady run."""
    run = Run(robots)
    async with Client(addresses) as client, operator_link(addresses) as operator:
        deliveries = Deliveries(robots, client)
        started_at, run.began = time.monotonic(), (await operator.clock()).time
        watch = asyncio.create_task(watch_robots(operator, run))
        jars = dict(zip(await asyncio.gather(*(deliveries.submit(jar) for jar in range(robots))), range(robots), strict=True))
        run.began += WARM_UP if steady else 0.0
        task_manager = next(iter(addresses.task_managers))
        version, limit = 0, run.began + (STEADY if steady else PATIENCE)
        while jars and (await operator.clock()).time < limit:
            news = await client.watch_list(WatchTasks(after=version, wait=5), task_manager)
            version, is_measured = news.version, (await operator.clock()).time >= run.began
            for row in news.rows:
                if row.outcome is None or row.task not in jars:
                    continue
                jar = jars.pop(row.task)
                run.outcomes[row.outcome] += is_measured
                if row.outcome is not Outcome.ACCOMPLISHED:
                    run.explanations[row.explanation] += 1
                if steady:
                    jars[await deliveries.submit(jar)] = jar
        run.outcomes["open"] += 0 if steady else len(jars)
        run.ended, run.wall = (await operator.clock()).time, time.monotonic() - started_at
        watch.cancel()
        await asyncio.wait([watch])
        for view in await client.tasks():
            for work in view.work[:1] if view.outcome is Outcome.ACCOMPLISHED else ():
                run.until_begun.append(work.began - view.submitted_at)
                run.at_work.append((view.ended_at or 0.0) - work.began)
    run.accomplished = run.outcomes[Outcome.ACCOMPLISHED]
    return run


async def watch_robots(operator: OperatorLink, run: Run) -> None:
    """Count the robots that drive, and those of them that wait."""
    earlier = await operator.robots()
    while True:
        await asyncio.sleep(SAMPLE)
        states = await operator.robots()
        for name, state in states.items():
            if state.activity in DRIVING and earlier[name].activity == state.activity:
                run.driving += 1
                run.waiting += math.dist((state.x, state.y), (earlier[name].x, earlier[name].y)) < STILL
        earlier = states


@asynccontextmanager
async def started(robots: int, folder: Path) -> AsyncIterator[int]:
    """A system with the hall, as `somrs up` starts it. Yields the process."""
    site = folder / "hall.yaml"
    site.write_text("\n".join(hall(robots)) + "\n")
    line = ["-m", "somrs.cli.main", "up", str(site), "--data", str(folder / "data"), "--world", "kinematic"]
    with (folder / "up.log").open("wb") as output:
        system = await asyncio.create_subprocess_exec(sys.executable, *line, stdout=output, stderr=output)
        try:
            while b"Running." not in (folder / "up.log").read_bytes():
                if system.returncode is not None:
                    raise SystemExit((folder / "up.log").read_text())
                await asyncio.sleep(0.2)
            yield system.pid
        finally:
            system.send_signal(signal.SIGINT)
            await system.wait()


def program_of(process: int) -> str:
    """Which program a process is, from its title: `somrs run PROGRAM ...`."""
    title = Path(f"/proc/{process}/cmdline").read_bytes().decode(errors="replace").replace("\0", " ")
    return title.partition("somrs run ")[2].partition(" ")[0] or "others"


async def measure(robots: int, *, steady: bool) -> None:
    """Print a row of the table, what the programs of the system cost, and why deliveries failed."""
    with tempfile.TemporaryDirectory() as folder:
        started_at = time.monotonic()
        async with started(robots, Path(folder)) as system:
            ready = time.monotonic() - started_at
            spent = {process: cpu(process) for process in descendants(system)}
            run = await play(robots, Addresses.read(Path(folder) / "data"), steady=steady)
            for process in descendants(system):
                program = program_of(process)
                run.cpu[program] = run.cpu.get(program, 0.0) + cpu(process) - spent.get(process, 0.0)
            run.memory = sum(map(memory, [system, *descendants(system)]))
    minutes = (run.ended - run.began) / 60
    share = run.waiting / max(run.driving, 1)
    print(
        f"{robots:6} {f'{run.accomplished} of {sum(run.outcomes.values())}':>12} {run.accomplished / minutes:10.1f} {60 * minutes:11.0f} "
        f"{run.wall:8.0f} {share:8.0%} {run.memory:8.0f} {ready:8.0f}",
        flush=True,
    )
    dearest = sorted(run.cpu.items(), key=lambda entry: -entry[1])[:6]
    print("       CPU: " + ", ".join(f"{program} {seconds:.0f} s" for program, seconds in dearest))
    if run.at_work:
        for label, share in (("half of the deliveries", 0.5), ("nine of ten", 0.9)):
            until_begun, at_work = (sorted(times)[int(share * len(times))] for times in (run.until_begun, run.at_work))
            print(f"       {label}: at most {until_begun:.1f} s until a robot begins, and {at_work:.1f} s from then on")
    for text, count in run.explanations.most_common(6):
        print(f"       {count} times: {text[:300]}")


def main() -> None:
    arguments = sys.argv[1:]
    kinds = [word for word in arguments if word in ("burst", "steady")] or ["burst", "steady"]
    numbers = [int(word) for word in arguments if word.isdigit()] or list(NUMBERS)
    for kind in kinds:
        print(f"\n{kind:6} {'deliveries':>12} {'a minute':>10} {'simulated s':>11} {'wall s':>8} {'waiting':>8} {'MB':>8} {'start s':>8}")
        for robots in numbers:
            asyncio.run(measure(robots, steady=kind == "steady"))


if __name__ == "__main__":
    main()

"""Measures what a building full of sensors costs: the shares of a core of the adapter for things and of the Repository, in a whole system.

Each sensor says a temperature as JSON over MQTT, every few seconds. It wanders by steps of 0.02 °C, so that few messages are news: the dead
band is 0.2 °C. In the second run, each message is news. Run it as `python benchmarks/things.py [NUMBER_OF_SENSORS ...]`.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator
from pathlib import Path
from urllib.parse import urlsplit

import aiomqtt

SPAN = 60.0
"""Seconds for which shares are measured."""
PERIOD = 5.0
"""Seconds between two messages of a sensor."""
WANDERING, NEWS = 0.02, 1.0
"""The steps of the temperature from message to message, °C."""

SITE = """
map: Hall
objects:
  House:
    type: Building
    parts:
      Ground:
        type: Storey
        parts: {Floor1: {type: Floor, at: [10, 10, -0.1], Shape: {Form: Box, Width: 20, Depth: 20, Height: 0.1}}}
adapters:
  things: {broker: own, mappings: [things.yaml]}
"""


def mapping(count: int) -> str:
    lines = ["things:"]
    for number in range(count):
        attribute = f"Temperature: {{topic: sensors/{number}, json: temperature, dead_band: 0.2}}"
        lines += [f"  Sensor{number}:", "    type: Sensor", "    connection: broker", f"    attributes: {{{attribute}}}"]
    return "\n".join(lines)


@contextlib.asynccontextmanager
async def system(folder: Path, count: int) -> AsyncIterator[aiomqtt.Client]:
    """Run a system with so many sensors. Yields a client of its broker."""
    (folder / "site.yaml").write_text(SITE)
    (folder / "things.yaml").write_text(mapping(count))
    command = [sys.executable, "-m", "somrs.cli.main", "up", "site.yaml", "--no-simulator", "--data", "data"]
    process = await asyncio.create_subprocess_exec(*command, cwd=folder, stdout=subprocess.PIPE)
    assert process.stdout is not None
    try:
        while not (await process.stdout.readline()).startswith(b"Running"):
            pass
        (adapter,) = json.loads((folder / "data" / "adapters.json").read_text())
        address = urlsplit(adapter["settings"]["broker"])
        async with aiomqtt.Client(address.hostname or "", address.port or 0) as client:
            yield client
    finally:
        process.terminate()
        await process.wait()


def processor_time(folder: Path, program: str) -> float:
    """The processor time, in seconds, of a program of the system in the folder."""
    for directory in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            is_program = (directory / "cmdline").read_bytes().replace(b"\0", b" ").startswith(f"somrs run {program} ".encode())
            if is_program and (directory / "cwd").resolve() == folder.resolve():
                fields = (directory / "stat").read_text().rpartition(")")[2].split()
                return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    raise RuntimeError(f"the system has no program {program}")


async def publish(client: aiomqtt.Client, count: int, step: float) -> None:
    """Be the sensors, until it is cancelled."""
    temperatures = [20.0] * count
    start, sent_count = time.perf_counter(), 0
    while True:
        number = sent_count % count
        temperatures[number] += random.choice((-step, step))
        await client.publish(f"sensors/{number}", json.dumps({"temperature": round(temperatures[number], 2), "battery": 97}))
        sent_count += 1
        await asyncio.sleep(max(start + sent_count * PERIOD / count - time.perf_counter(), 0))


async def measure(count: int, step: float) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        async with system(folder, count) as client:
            sensors = asyncio.create_task(publish(client, count, step))
            await asyncio.sleep(4 * PERIOD)  # until all sensors are on the map
            programs = ("adapter things", "repository")
            spent, start = [processor_time(folder, program) for program in programs], time.perf_counter()
            await asyncio.sleep(SPAN)
            shares = [
                (processor_time(folder, program) - earlier) / (time.perf_counter() - start)
                for program, earlier in zip(programs, spent, strict=True)
            ]
            sensors.cancel()
            await asyncio.wait({sensors})
    kind = "each is news" if step == NEWS else "few are news"
    print(f"{count:5} sensors, {count / PERIOD:4.0f} messages/s, {kind}: adapter {shares[0]:6.1%}, Repository {shares[1]:6.1%}", flush=True)


def main() -> None:
    counts = [int(argument) for argument in sys.argv[1:]] or [200]
    for count in counts:
        for step in (WANDERING, NEWS):
            asyncio.run(measure(count, step))


if __name__ == "__main__":
    main()

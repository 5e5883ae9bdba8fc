"""The simulator as a program: `python -m somrs.devices.simulator.program --map FILE... --port N --speed max`.

Prints one line of JSON, with the address, when robots can be reached. Ends at SIGTERM and SIGINT.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import signal
import sys
from collections.abc import Callable
from pathlib import Path

from somrs.devices.simulator.server import Server
from somrs.devices.simulator.simulation import Simulation
from somrs.errors import SomrsError, UsageError
from somrs.ontology.files import load
from somrs.ontology.objects import Map
from somrs.ontology.types import Ontology


async def serve(
    map: Map,
    ontology: Ontology,
    host: str = "127.0.0.1",
    port: int = 0,
    speed: float | None = None,
    ready: Callable[[Server], None] = lambda server: None,
) -> None:
    """Build the world of a map, and serve it until cancelled. `ready` is called once it can be reached."""
    server = Server(Simulation(map, ontology), host=host, port=port, speed=speed)
    await server.start()
    try:
        ready(server)
        await server.ended()
    finally:
        await server.stop()


def speed_of(text: str) -> float | None:
    """`max`, or a factor."""
    if text == "max":
        return None
    try:
        speed = float(text)
    except ValueError:
        speed = 0.0
    if not 0.001 <= speed <= 1000:
        raise argparse.ArgumentTypeError(f"{text!r} is not a speed: write max, or how many simulated seconds pass in a second, such as 1")
    return speed


async def _until_told(arguments: argparse.Namespace) -> None:
    loaded = load(arguments.map)
    if loaded.map is None:
        raise UsageError(f"{', '.join(map(str, arguments.map))}: there is no map in it; `objects:` are missing")
    serving = asyncio.ensure_future(
        serve(
            loaded.map,
            loaded.ontology,
            port=arguments.port,
            speed=arguments.speed,
            ready=lambda server: print(json.dumps({"ready": "simulator", "at": f"{server.host}:{server.port}"}), flush=True),
        )
    )
    for wanted in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(wanted, serving.cancel)
    try:
        await serving
    except asyncio.CancelledError:
        return


def main() -> int:
    parser = argparse.ArgumentParser(prog="somrs.devices.simulator.program", description=__doc__.splitlines()[0])
    parser.add_argument("--map", nargs="+", type=Path, required=True, metavar="FILE", help="the files of an ontology and a map")
    parser.add_argument("--port", type=int, default=0, help="the TCP port to listen at; 0: any that is free")
    parser.add_argument("--speed", type=speed_of, default=None, help="max, or how many simulated seconds pass in a second (default: max)")
    try:
        asyncio.run(_until_told(parser.parse_args()))
    except SomrsError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Simulated Pioneer robots as a program.

    python -m somrs.adapters.arcos.simulated Robot1:8101 Robot2:8102 --simulator 127.0.0.1:8700
    python -m somrs.adapters.arcos.simulated Robot1:8101 --start 1 0.8 90

The first gives robots of a running simulator ARCOS controllers; the second has a robot that stands alone in an empty plane.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import logging
import math

from somrs.adapters.arcos.simulated.body import Place, PlaneBody
from somrs.adapters.arcos.simulated.firmware import Firmware
from somrs.adapters.arcos.simulated.link_body import serve_simulated
from somrs.adapters.arcos.simulated.server import SimulatedRobot, serving_tcp

log = logging.getLogger(__name__)


def _robot_port(text: str) -> tuple[str, int]:
    name, colon, port = text.rpartition(":")
    if not colon or not port.isdigit():
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME:PORT, such as Robot1:8101")
    return name, int(port)


async def _serve_alone(robots: dict[str, int], start: tuple[float, float, float]) -> None:
    """Robots in planes of their own, until cancelled."""
    async with contextlib.AsyncExitStack() as stack:
        for name, port in robots.items():
            body = PlaneBody(Place(x=start[0], y=start[1], yaw=math.radians(start[2])))
            address = await stack.enter_async_context(serving_tcp(SimulatedRobot(Firmware(body, name=name)), port))
            log.info("%s: ARCOS at %s", name, address)
        await asyncio.get_running_loop().create_future()


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m somrs.adapters.arcos.simulated", description="Simulated Pioneer robots with ARCOS.")
    parser.add_argument("robots", nargs="+", type=_robot_port, metavar="NAME:PORT", help="a robot, and its TCP port")
    parser.add_argument("--simulator", metavar="HOST:PORT", help="the simulator of the robots; without it, each stands alone")
    parser.add_argument(
        "--start", nargs=3, type=float, default=(0.0, 0.0, 0.0), metavar=("X", "Y", "DEGREES"), help="where robots stand alone"
    )
    arguments = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    robots = dict(arguments.robots)
    serving = serve_simulated(robots, arguments.simulator) if arguments.simulator else _serve_alone(robots, tuple(arguments.start))
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(serving)


if __name__ == "__main__":
    main()

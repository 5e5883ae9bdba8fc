"""Simulated vehicles as a program.

    python -m somrs.adapters.vda5050.simulated Robot1 Robot2 --broker mqtt://127.0.0.1:1883 --simulator 127.0.0.1:8700
    python -m somrs.adapters.vda5050.simulated Robot1 --broker mqtt://127.0.0.1:1883 --start 1 0.8 90 --version 3.0

The first puts robots of a running simulator behind the broker; the second has a vehicle alone in an empty plane. Serial numbers are the
names of the robots.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import logging
import math
from pathlib import Path

from somrs.adapters.vda5050.messages.header import Version
from somrs.adapters.vda5050.mqtt import BrokerAddress, Certificates, broker_address
from somrs.adapters.vda5050.simulated.body import StandInBody
from somrs.adapters.vda5050.simulated.factsheet import factsheet
from somrs.adapters.vda5050.simulated.link_body import serve_simulated
from somrs.adapters.vda5050.simulated.program import MqttVehicle, address_of, serve
from somrs.adapters.vda5050.simulated.vehicle import SimulatedVehicle
from somrs.errors import UsageError

VERSIONS = {"2.0": Version.V2_0, "2.1": Version.V2_1, "3.0": Version.V3_0}


def _alone(names: list[str], version: Version, broker: BrokerAddress, start: tuple[float, float, float]) -> list[MqttVehicle]:
    return [
        MqttVehicle(
            address_of(name, version, "SOMRS"),
            SimulatedVehicle(version, factsheet(), map_id="map"),
            StandInBody(start[0], start[1], math.radians(start[2])),
            broker,
        )
        for name in names
    ]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m somrs.adapters.vda5050.simulated", description="Simulated vehicles with VDA 5050.")
    parser.add_argument("names", nargs="+", metavar="NAME", help="a vehicle, and its serial number")
    parser.add_argument("--broker", required=True, metavar="mqtt://HOST:PORT", help="the MQTT broker")
    parser.add_argument("--version", choices=VERSIONS, default="2.1", help="the version of VDA 5050")
    parser.add_argument("--simulator", metavar="HOST:PORT", help="the simulator of the robots; without it, each stands alone")
    parser.add_argument(
        "--start", nargs=3, type=float, default=(0.0, 0.0, 0.0), metavar=("X", "Y", "DEGREES"), help="where vehicles stand alone"
    )
    arguments = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    version = VERSIONS[arguments.version]
    try:
        broker = broker_address(arguments.broker, Certificates(), Path())
    except UsageError as error:
        parser.error(str(error))
    with contextlib.suppress(KeyboardInterrupt):
        if arguments.simulator:
            robots = {name: (address_of(name, version, "SOMRS"), version) for name in arguments.names}
            asyncio.run(serve_simulated(robots, arguments.simulator, broker))
        else:
            asyncio.run(serve(_alone(arguments.names, version, broker, tuple(arguments.start))))


if __name__ == "__main__":
    main()

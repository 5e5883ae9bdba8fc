"""Measures fleet control of VDA 5050 vehicles: its share of a core, and how long it takes until an order is at the broker.

The vehicles are simulated in a process of their own, behind a NATS server; each sends a state a second, and one whenever something changes.
All drive, and are granted two more places every few seconds, as by traffic. Run it as
`python benchmarks/vda5050.py [NUMBER_OF_VEHICLES ...]`.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import shutil
import statistics
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import AsyncIterator
from pathlib import Path

import aiomqtt

from somrs.adapters.vda5050.adapter import Vda5050Adapter
from somrs.adapters.vda5050.control.exchange import BuildingChanged, Effect, Follow, Passed
from somrs.adapters.vda5050.messages.header import Version
from somrs.adapters.vda5050.messages.orders import ZoneType
from somrs.adapters.vda5050.mqtt import BrokerAddress
from somrs.adapters.vda5050.robot import Vda5050Vehicle
from somrs.adapters.vda5050.simulated.body import StandInBody
from somrs.adapters.vda5050.simulated.factsheet import factsheet
from somrs.adapters.vda5050.simulated.program import MqttVehicle, address_of, serve
from somrs.adapters.vda5050.simulated.vehicle import SimulatedVehicle
from somrs.adapters.vda5050.zoning.site import SiteZone
from somrs.devices.road_robot import Waypoint
from somrs.ports import listen_at
from somrs.service_manager.sdk.device import Device

SPAN = 30.0
"""Seconds for which the share of a core is measured."""
SPACING = 2.0
"""Distance between two places, m."""
GRANT = 3.0
"""Seconds between two grants."""
AHEAD = 8
"""Places that are planned and not granted."""
ZONES = tuple(
    SiteZone(name=f"Zone{index}", zone_type=zone_type, outline=((x, y), (x + 2.0, y), (x + 2.0, y + 2.0), (x, y + 2.0)), level=0.0)
    for index in range(20)
    for x, (zone_type, y) in ((8.0 + 10.0 * index, ((ZoneType.RELEASE, -1.0) if index % 2 else (ZoneType.BLOCKED, 5.0))),)
)
"""Every 20 m of the way, vehicles with 3.0 have to ask before they go on."""


class Vehicle:
    """A vehicle on an endless way along the x axis."""

    def __init__(self, device: Vda5050Vehicle) -> None:
        self.device, self.passed, self.granted = device, 0, 0
        device.session.on_effect = self._notice

    def _notice(self, effect: Effect) -> None:
        if isinstance(effect, Passed):
            self.passed = effect.number

    def grant(self) -> None:
        """Release two more places."""
        self.granted = self.passed + 2
        places = range(self.passed, self.granted + AHEAD)
        way = tuple(
            Waypoint(number=number, name=f"Place{number}", x=SPACING * number, y=0.0, level=0.0, released=number <= self.granted)
            for number in places
        )
        self.device.session.give(Follow(way=way))


class Fleet:
    data = Path(".somrs")

    def __init__(self) -> None:
        self.vehicles: list[Vehicle] = []

    def add(self, device: Device) -> None:
        assert isinstance(device, Vda5050Vehicle), "the adapter has no others"
        self.vehicles.append(Vehicle(device))
        device.session.give(BuildingChanged(zones=ZONES))

    def report_problem(self, name: str, problem: str | None) -> None: ...

    async def remove(self, name: str) -> None: ...

    async def storeys(self) -> dict[str, float]:
        return {}


@contextlib.asynccontextmanager
async def broker(folder: Path) -> AsyncIterator[int]:
    """Run a NATS server with MQTT. Yields its port."""
    with listen_at("127.0.0.1", 0) as first, listen_at("127.0.0.1", 0) as second:
        nats_port, port = first.getsockname()[1], second.getsockname()[1]
    settings = folder / "nats.json"
    mqtt = {"host": "127.0.0.1", "port": port}
    settings.write_text(
        json.dumps({"server_name": "broker", "host": "127.0.0.1", "port": nats_port, "mqtt": mqtt, "jetstream": {"store_dir": str(folder)}})
    )
    program = shutil.which("nats-server", path=sysconfig.get_path("scripts"))
    assert program is not None, "the extra `vda5050` is installed"
    process = subprocess.Popen([program, "--config", str(settings)], stderr=subprocess.DEVNULL)
    await asyncio.sleep(1.0)
    try:
        yield port
    finally:
        process.kill()
        process.wait()


async def run_vehicles(port: int, count: int) -> None:
    """The other process: all vehicles, until it is killed."""
    address = BrokerAddress(servers=(("127.0.0.1", port),))
    versions = (Version.V2_1, Version.V3_0)
    await serve(
        MqttVehicle(
            address_of(f"{number:04}", versions[number % 2], "acme"),
            SimulatedVehicle(versions[number % 2], factsheet(), map_id="hall"),
            StandInBody(),
            address,
        )
        for number in range(count)
    )


async def latencies(port: int, fleet: Fleet) -> list[float]:
    """Seconds from each `follow` until another client of the broker has the order, one vehicle after another."""
    times = []
    async with aiomqtt.Client("127.0.0.1", port) as client:
        await client.subscribe("+/+/+/+/order")
        messages = aiter(client.messages)
        for vehicle in fleet.vehicles:
            started = time.perf_counter()
            vehicle.grant()
            while vehicle.device.session.address.serial_number not in (await anext(messages)).topic.value:
                pass
            times.append(time.perf_counter() - started)
    return times


async def measure(count: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        async with broker(Path(folder)) as port:
            vehicles = subprocess.Popen([sys.executable, __file__, "--vehicles", str(port), str(count)])
            fleet = Fleet()
            control = asyncio.create_task(Vda5050Adapter({"broker": f"mqtt://127.0.0.1:{port}"}, Path()).run(fleet))
            try:
                while len(fleet.vehicles) < count:
                    await asyncio.sleep(0.5)
                times = await latencies(port, fleet)
                spent, started = time.process_time(), time.perf_counter()
                while time.perf_counter() < started + SPAN:
                    for vehicle in fleet.vehicles:
                        vehicle.grant()
                        await asyncio.sleep(GRANT / count)
                share = (time.process_time() - spent) / (time.perf_counter() - started)
                distance = statistics.mean(vehicle.passed for vehicle in fleet.vehicles) * SPACING
                middle, slow = statistics.median(times), statistics.quantiles(times, n=100)[98] if count > 1 else times[0]
                print(
                    f"{count:4} vehicles: {share:5.1%} of a core; an order is out after {1000 * middle:5.1f} ms "
                    f"(99 %: {1000 * slow:5.1f} ms); each drove {distance:.0f} m",
                    flush=True,
                )
            finally:
                vehicles.kill()
                vehicles.wait()
                control.cancel()
                await asyncio.wait({control})


def main() -> None:
    if sys.argv[1:2] == ["--vehicles"]:
        asyncio.run(run_vehicles(int(sys.argv[2]), int(sys.argv[3])))
        return
    for count in [int(argument) for argument in sys.argv[1:]] or [10, 100]:
        asyncio.run(measure(count))


if __name__ == "__main__":
    main()

"""Whole systems of real processes, and a robot of another make that finds traffic in the list of addresses."""

from __future__ import annotations

import asyncio
import json
import urllib.request
from pathlib import Path
from typing import Any

import pytest

from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.files.dump import dump_map
from somrs.ontology.files.loading import upper
from somrs.ontology.objects import ObjectAdded
from somrs.protocol.messages.knowledge import UpdateMap
from tests.support import warm
from tests.support.foreign_robot import ForeignRobot
from tests.support.paths import SCENARIO_1
from tests.support.signed_in import note
from tests.support.simulated_tower import tower
from tests.support.simulator_room import box, robot

pytestmark = pytest.mark.long

LEASE = 600.0
LONGEST = 300.0
"""Seconds after which a test gives up. It takes ten on an idle machine."""


def get(addresses: Addresses, path: str) -> Any:
    with urllib.request.urlopen(f"{addresses.api}/{path}", timeout=LONGEST) as response:
        return json.load(response)


def travel(addresses: Addresses) -> None:
    """A robot of another make makes a trip on the lowest floor, between the robots that stand there."""
    assert addresses.traffic is not None
    parts = {part["name"]: part for part in get(addresses, "system")["parts"]}
    assert parts["Traffic"]["address"] == addresses.traffic
    assert parts["Traffic"]["milliseconds"] is not None
    foreigner = ForeignRobot("Foreigner", addresses.traffic, LONGEST)
    while not foreigner.places:
        foreigner.read_roadmap()
    berths = [(berth.X, berth.Y) for berth in foreigner.service.ReadTraffic().Berths]
    """Where the other robots stand."""
    corner, far_corner = (min(berths), max(berths)) if berths else ((0.0, 0.0), (9.0, 9.0))
    on_floor = [name for name, place in foreigner.places.items() if place.level == 0.0]
    by_distance = sorted(on_floor, key=lambda name: foreigner.distance(name, *corner) - foreigner.distance(name, *far_corner))
    start, goal = by_distance[len(by_distance) // 3], by_distance[len(by_distance) * 2 // 3]
    foreigner.enter(start, LEASE, Edition=foreigner.edition)
    foreigner.request("there", goal)
    foreigner.drive_until(lambda: "there" in foreigner.ended)
    assert foreigner.ended["there"] == ("arrived", [])
    seen, place = get(addresses, "traffic"), foreigner.places[foreigner.place]
    granted = {robot["robot"]: robot["granted"] for robot in seen["robots"]}["Foreigner"]
    assert granted == [[round(place.x, 2), round(place.y, 2), round(place.level, 2)]]
    assert granted[0] in get(addresses, "traffic/roadmap")["places"]
    foreigner.service.LeaveTraffic(Robot="Foreigner")
    foreigner.close()


def test_a_robot_of_another_make_drives_in_a_simulated_building(tmp_path: Path) -> None:
    async def run() -> None:
        system = System([SCENARIO_1], tmp_path, world=WorldKind.KINEMATIC, launcher=warm.launcher(), certificates=False)
        async with asyncio.timeout(LONGEST), system:
            addresses = Addresses.read(tmp_path)
            note(tmp_path, addresses.api)
            await asyncio.to_thread(travel, addresses)
            async with Client(addresses) as client:
                await build(client, addresses.traffic or "")

    asyncio.run(run())


async def build(client: Client, traffic: str) -> None:
    """Build something beside a robot of another make, which is told of the new roadmap."""
    foreigner = await asyncio.to_thread(ForeignRobot, "Foreigner", traffic, LONGEST)
    await asyncio.to_thread(foreigner.read_roadmap)
    held = {held for seen in foreigner.service.ReadTraffic().Robots for held in seen.Held}
    place = next(name for name in reversed(foreigner.places) if name not in held)
    await asyncio.to_thread(foreigner.enter, place, LEASE)
    shelf = box("Shelf99", "Cupboard", (foreigner.places[place].x + 1.0, foreigner.places[place].y, 0), (0.3, 0.3, 0.8))
    await client.update(UpdateMap(changes=(ObjectAdded(shelf),)))
    await asyncio.to_thread(foreigner.wait_until, lambda: foreigner.is_replaced)
    edition = foreigner.edition
    await asyncio.to_thread(foreigner.read_roadmap)
    assert foreigner.edition > edition
    foreigner.close()


def test_a_building_without_a_simulator_has_traffic_as_a_program_of_its_own(tmp_path: Path) -> None:
    site = tmp_path / "site.yaml"
    site.write_text(dump_map(tower(extra_objects=[robot("Foreigner", (1, 1, 0), type="MobileRobot")]), upper()))

    async def run() -> None:
        system = System([site], tmp_path / "data", simulates=False, launcher=warm.launcher(), certificates=False)
        async with asyncio.timeout(LONGEST), system:
            addresses = Addresses.read(tmp_path / "data")
            note(tmp_path / "data", addresses.api)
            assert addresses.simulator is None
            await asyncio.to_thread(travel, addresses)

    asyncio.run(run())


def test_a_simulated_device_needs_the_simulator(tmp_path: Path) -> None:
    async def run() -> list[str]:
        async with System([SCENARIO_1], tmp_path, simulates=False, launcher=warm.launcher()) as system:
            return system.problems

    problems = asyncio.run(run())
    assert any(problem.startswith("Robot1 is left out: it is a device of the simulator") for problem in problems)

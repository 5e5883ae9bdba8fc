"""Whole systems of real processes, and a robot of another make that finds traffic in the list of addresses."""

from __future__ import annotations

import asyncio
import json
import urllib.request
from pathlib import Path

import pytest

from somrs.client.client import Addresses
from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from tests.support import warm
from tests.support.foreign_robot import ForeignRobot
from tests.support.hang import HANG_TIME
from tests.support.paths import SCENARIO_1

pytestmark = pytest.mark.long

LEASE = 600.0


def travel(addresses: Addresses) -> None:
    """A robot of another make makes a trip to the farthest place of the building."""
    assert addresses.traffic is not None
    with urllib.request.urlopen(f"{addresses.api}/system", timeout=HANG_TIME) as response:
        parts = {part["name"]: part for part in json.load(response)["parts"]}
    assert parts["Traffic"]["address"] == addresses.traffic
    assert parts["Traffic"]["milliseconds"] is not None
    foreigner = ForeignRobot("Foreigner", addresses.traffic, HANG_TIME)
    foreigner.read_roadmap()
    berths = [(berth.X, berth.Y) for berth in foreigner.service.ReadTraffic().Berths]
    """Where the other robots stand."""
    corner, far_corner = (min(berths), max(berths)) if berths else ((0.0, 0.0), (9.0, 9.0))
    by_distance = sorted(foreigner.places, key=lambda name: foreigner.distance(name, *corner) - foreigner.distance(name, *far_corner))
    start, goal = by_distance[len(by_distance) // 3], by_distance[len(by_distance) * 2 // 3]
    foreigner.enter(start, LEASE, Edition=foreigner.edition)
    foreigner.request("there", goal)
    foreigner.drive_until(lambda: "there" in foreigner.ended)
    assert foreigner.ended["there"] == ("arrived", [])
    foreigner.service.LeaveTraffic(Robot="Foreigner")
    foreigner.close()


def test_a_robot_of_another_make_drives_in_a_simulated_building(tmp_path: Path) -> None:
    async def run() -> None:
        system = System([SCENARIO_1], tmp_path, world=WorldKind.KINEMATIC, launcher=warm.launcher())
        async with asyncio.timeout(HANG_TIME), system:
            await asyncio.to_thread(travel, Addresses.read(tmp_path))

    asyncio.run(run())

"""The waypoints of robots of any make have the names of the Places of the map that are there."""

from __future__ import annotations

import asyncio
from pathlib import Path

from tests.support.road_lab import RoadLab, in_virtual_time
from tests.support.robot_lab import SITE


def test_a_way_to_a_place_ends_with_its_name(tmp_path: Path) -> None:
    async def test() -> None:
        lab = RoadLab(tmp_path, SITE.replace("  Jar1: {", "  Dock: {type: Place, at: [5, 2.5]}\n  Jar1: {"))
        robot = lab.robots["Robot1"]
        await lab.start()
        for _ in range(2):
            await robot.link.drive_to(5.0, 2.5)
            assert [waypoint.mark for waypoint in robot.ways_told[-1]][-1] == "Dock"
            await robot.link.approach("Jar1")
            assert robot.ways_told[-1][-1].mark == ""
            await asyncio.sleep(5.0)

    in_virtual_time(test())

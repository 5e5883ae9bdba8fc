"""Robots that have come to where they work stay there until they have worked, whoever wants to pass."""

from __future__ import annotations

import asyncio
from pathlib import Path

from tests.support.road_lab import RoadLab, in_virtual_time


def test_a_robot_is_not_sent_away_from_where_it_is_to_work(tmp_path: Path) -> None:
    """Seen with ROS 2: what was granted beyond its stand, for others that waited, took the robot away while its arm worked."""

    async def test() -> None:
        lab = RoadLab(tmp_path)
        worker, other = lab.robots["Robot1"], lab.robots["Robot2"]
        await lab.start()
        approach = asyncio.create_task(worker.link.approach("Jar1"))
        while len(worker.ways_told) < 2:
            await asyncio.sleep(0.1)
        stand = worker.ways_told[-1][-1]
        passing = asyncio.create_task(other.link.drive_to(stand.x, stand.y))
        await approach
        point = worker.body.x, worker.body.y
        await asyncio.sleep(5.0)
        assert (worker.body.x, worker.body.y) == point
        await worker.link.grip("Jar1")
        assert (worker.body.x, worker.body.y) == point
        assert lab.places["Jar1"] is None
        await passing  # it makes room when it has worked
        assert abs(other.body.x - stand.x) + abs(other.body.y - stand.y) < 0.1

    in_virtual_time(test())

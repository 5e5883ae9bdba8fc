"""A roadmap that does not fit together is not gone by, and the next one is."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from somrs.errors import RemoteError
from somrs.traffic.robot_tasks import Locate, RoadmapRead, Standing
from tests.support.road_lab import RoadLab, in_virtual_time


def test_a_roadmap_that_does_not_fit_together_leaves_the_robot_where_it_was_and_the_next_one_counts(tmp_path: Path) -> None:
    """Seen: after such a roadmap, each question about the building ended in an AssertionError, whatever was read later."""

    async def test() -> None:
        lab = RoadLab(tmp_path, robots=("Robot1",))
        robot = lab.robots["Robot1"]
        standing = asyncio.create_task(robot.stand_by())
        await robot.link.__aenter__()
        fit = lab.read_roadmap()
        unfit = RoadmapRead(fit.edition, (*fit.places, fit.places[0]))
        for _ in range(2):
            with pytest.raises(RemoteError, match=f"reads it again: {fit.places[0].name} is the name of two places"):
                await robot.road.carry_out(Locate(unfit))
            with pytest.raises(RemoteError, match="does not take part in traffic yet"):
                await robot.link.legs()
        assert isinstance(await robot.road.carry_out(Locate(fit)), Standing)
        await robot.link.legs()
        standing.cancel()

    in_virtual_time(test())

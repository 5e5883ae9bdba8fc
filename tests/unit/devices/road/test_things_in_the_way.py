"""Things on the floor are in the way: quotes know it, and trips that traffic refuses are asked for again after a pause."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from somrs.devices.road.link import RETRYING
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.lines import StandAt
from somrs.kernel.component import Notified
from somrs.traffic.notices import CloseWays
from tests.support.road_lab import RoadLab, in_virtual_time
from tests.support.robot_lab import SITE

ROW = [f"Carton{number}" for number in range(10)]
BLOCKED = SITE.replace(
    "facts:", "".join(f"  {name}: {{type: Carton, at: [4, {0.3 + 0.6 * number:.1f}, 0]}}\n" for number, name in enumerate(ROW)) + "facts:"
)


def test_there_is_no_quote_for_a_way_on_which_things_stand(tmp_path: Path) -> None:
    """Seen: a quote was offered, and then no path was found, because of what stood there."""

    async def test() -> None:
        lab = RoadLab(tmp_path, BLOCKED, robots=("Robot1",))
        await lab.start()
        link = lab.robots["Robot1"].link
        assert (await link.legs(StandAt(x=2.0, y=3.0))).lengths != (None,)
        assert (await link.legs(StandAt(x=6.0, y=3.0))).lengths == (None,)
        assert (await link.legs(ROW[5])).lengths != (None,), "what it is to take is not in the way"

    in_virtual_time(test())


def test_a_trip_that_traffic_refuses_is_asked_for_again(tmp_path: Path) -> None:
    """Seen: five tries within ten seconds, and the task had failed. After that, the robot stood still with a way that it was granted."""

    async def test() -> None:
        lab = RoadLab(tmp_path, robots=("Robot1",))
        await lab.start()
        loop, link = asyncio.get_running_loop(), lab.robots["Robot1"].link
        everywhere = CloseWays(places=tuple(place.name for place in lab.read_roadmap().places if place.x > 3.0))
        lab.handle("traffic", Notified(everywhere))
        start_time = loop.time()
        with pytest.raises(RobotGaveUp, match="finds no path to"):
            await link.drive_to(6.0, 3.0)
        assert loop.time() >= start_time + RETRYING
        opening = loop.call_later(5.0, lab.handle, "traffic", Notified(CloseWays()))
        await link.drive_to(6.0, 3.0)
        opening.cancel()

    in_virtual_time(test())

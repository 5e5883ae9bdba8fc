"""Robots of any make stand still while an operator has stopped them, and drive slowly through slow zones."""

from __future__ import annotations

import asyncio

from somrs.devices.road.waypoints import Waypoint, with_slow_zones
from somrs.space.solids import Role, Solid
from somrs.space.zones import Zone, Zones
from tests.support.road_lab import LabRobot, RoadLab, in_lab


@in_lab
async def test_a_robot_that_is_stopped_on_its_way_goes_on_afterwards(lab: RoadLab, robot: LabRobot) -> None:
    following = asyncio.create_task(robot._follow_stops())
    approaching = asyncio.create_task(robot.link.approach("Platform1"))
    await asyncio.sleep(2.0)
    lab.report("Robot1.Paused = TRUE")
    await asyncio.sleep(1.0)
    place = robot.body.x, robot.body.y
    await asyncio.sleep(60.0)
    assert (robot.body.x, robot.body.y) == place
    assert not approaching.done()
    lab.report("Robot1.Paused = FALSE")
    await approaching
    following.cancel()


def waypoint(number: int, x: float, *, level: float = 0.0, speed_limit: float | None = None) -> Waypoint:
    return Waypoint(number=number, name=f"P{number}", x=x, y=0.0, level=level, released=True, speed_limit=speed_limit)


def test_a_way_through_a_slow_zone_is_slow() -> None:
    area = Solid(name="Z", type="SlowZone", role=Role.MARK, x=3.0, y=0.0, z=0.0, yaw=0.0, form="Box", width=0.5, depth=2.0)
    zones = Zones((Zone(area, 0.3),))
    way = with_slow_zones([waypoint(0, 0.0), waypoint(1, 2.0, speed_limit=0.8), waypoint(2, 4.0, speed_limit=0.8), waypoint(3, 6.0)], zones)
    assert [item.speed_limit for item in way] == [None, 0.8, 0.3, None]
    upstairs = with_slow_zones([waypoint(0, 0.0, level=4.0), waypoint(1, 6.0, level=4.0)], zones)
    assert [item.speed_limit for item in upstairs] == [None, None]

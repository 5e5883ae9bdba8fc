"""What a robot of the simulator reaches ahead of it: for controllers whose grippers are told no names."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping

from somrs.devices.simulator.link.commands import CommandDone, RobotState
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.link import RobotLink

log = logging.getLogger(__name__)

REACH, SUPPORT_REACH = 1.0, 2.0
"""How far from the robot's centre it takes things, and how far the middle of a support may be, m."""
ASIDE, SUPPORT_ASIDE = math.radians(30), math.radians(80)
"""How far aside of where the robot looks a thing may be, and the middle of a support, which may be wide, rad."""


def things_ahead(state: RobotState, things: Mapping[str, tuple[float, float]]) -> list[str]:
    """The things that the robot can take, of those at these points, m; that first which is straightest ahead."""
    return _ahead(state, things, REACH, ASIDE)


async def put_ahead(link: RobotLink) -> CommandDone:
    """Put what the robot holds on the piece of furniture before it, or on the floor if none takes it. Raises RobotGaveUp."""
    view = await link.sense(radius=SUPPORT_REACH)
    landmarks = {landmark.object: (landmark.x, landmark.y) for landmark in view.object_states}
    for support in _ahead(view.state, landmarks, SUPPORT_REACH, SUPPORT_ASIDE):
        try:
            return await link.place(support)
        except RobotGaveUp as failure:
            log.debug("%s does not put it on %s: %s", link.robot, support, failure)
    return await link.put_down_object()


def _ahead(state: RobotState, points: Mapping[str, tuple[float, float]], reach: float, aside: float) -> list[str]:
    """The objects in reach, that first which is straightest ahead."""
    bearings = {}
    for name, (x, y) in points.items():
        bearing = abs(math.remainder(math.atan2(y - state.y, x - state.x) - state.yaw, math.tau))
        if bearing < aside and math.dist((x, y), (state.x, state.y)) < reach:
            bearings[name] = bearing
    return sorted(bearings, key=lambda name: bearings[name])

"""Explores a floor: looks, drives to the next frontier, and looks again, until nothing is left that can be looked at."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence

from somrs.adapters.mapping.survey import Survey, legs_of
from somrs.devices.simulator.link.command_link import CommandLink
from somrs.devices.simulator.link.commands import CommandDone, RobotState, Scan
from somrs.devices.simulator.link.commands import Point as SeenPoint
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.sites.plan import Point

SCAN = Scan(rays=720, range=8.0)
"""What the robot's scanner measures."""
SKIPPED = ("blocked", "unreachable")
"""Reasons of failure for which the robot looks somewhere else."""
PATIENCE = 5.0
"""How long something may stand in the robot's way until it looks somewhere else, s of simulated time."""
POLL = 0.2
"""Seconds between two looks whether something stands in its way."""

Noted = Callable[[CommandDone], Awaitable[None]]
"""Called after each look, with what the camera saw."""
Expected = Callable[[], Sequence[SeenPoint]]
"""The points at which something should be, of which each look tells whether they are in clear view."""


async def explore(link: CommandLink, survey: Survey, noted: Noted, expected: Expected = tuple) -> RobotState:
    """Explore until nothing is left that can be looked at. Returns the robot's last state.

    Raises RobotGaveUp if the robot cannot go on.
    """
    state = await _look(link, survey, noted, expected)
    while (frontier := survey.next_frontier((state.x, state.y))) is not None:
        survey.note_looked_at(frontier)
        for point in legs_of(frontier.way):
            is_there = await _drive(link, point)
            state = await _look(link, survey, noted, expected)
            if not is_there:
                break
    return state


async def _drive(link: CommandLink, point: Point) -> bool:
    """Drive straight to a point. Returns whether the robot has come there. Raises RobotGaveUp if it cannot drive at all."""
    drive = asyncio.ensure_future(link.drive_along([point]))
    obstructed_at: float | None = None
    is_stopped = False
    try:
        while not drive.done():
            await asyncio.wait({drive}, timeout=POLL)
            state = link.state
            if state is None or not state.obstructed:
                obstructed_at = None
            elif obstructed_at is None:
                obstructed_at = state.time
            elif state.time - obstructed_at >= PATIENCE and not drive.done():
                is_stopped = True
                await link.stop()
        drive.result()
    except RobotGaveUp as failure:
        if failure.reason not in SKIPPED and not is_stopped:
            raise
        return False
    finally:
        drive.cancel()
    return True


async def _look(link: CommandLink, survey: Survey, noted: Noted, expected: Expected) -> RobotState:
    """Scan and look from where the robot stands."""
    scanned = await link.scan(SCAN)
    state = scanned.state
    survey.add_scan(state.x, state.y, state.yaw, SCAN, scanned.ranges)
    view = await link.sense(furniture=True, expected=[*expected()])
    survey.add_robots([(sighting.x, sighting.y) for sighting in view.sightings if sighting.robot])
    survey.add_furniture([sighting for sighting in view.sightings if sighting.furniture])
    await noted(view)
    return state

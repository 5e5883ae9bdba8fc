"""Explores a floor: looks, drives to the next frontier, and looks again, until nothing is left that can be looked at.

Doors with a drive that are shut on the map are opened when nothing else is left, one after the other, and closed when the robot does not
need them any more.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence

from somrs.adapters.mapping.doors import Doors, NoDoors
from somrs.adapters.mapping.survey import Survey
from somrs.adapters.mapping.ways import View
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


async def explore(link: CommandLink, survey: Survey, noted: Noted, expected: Expected = tuple, doors: Doors | None = None) -> RobotState:
    """Explore until nothing is left that can be looked at. Returns the robot's last state.

    Raises RobotGaveUp if the robot cannot go on. Then doors may be open that it has had opened.
    """
    doors = doors if doors is not None else NoDoors()

    async def look() -> RobotState:
        return await _look(link, survey, noted, expected)

    state = await look()
    while True:
        while (view := survey.next_view((state.x, state.y))) is not None:
            survey.note_looked_at(view)
            state = await _go(link, view, look)
        choice = survey.next_door((state.x, state.y), await doors.shut())
        ahead = choice[1].stand if choice is not None else None
        for closable in survey.closable_doors((state.x, state.y), ahead):
            if (view_beside := survey.stand_beside(closable, (state.x, state.y))) is not None:
                state = await _go(link, view_beside, look)
            survey.note_closed(closable)
            await doors.close(closable.name)
        if choice is None:
            return state
        door, door_view = choice
        survey.note_tried(door)
        state = await _go(link, door_view, look)
        if await doors.open(door.name):
            survey.note_open(door)
            state = await look()
            if (view_through := survey.look_through(door, (state.x, state.y))) is not None:
                state = await _go(link, view_through, look)


async def _go(link: CommandLink, view: View, look: Callable[[], Awaitable[RobotState]]) -> RobotState:
    """Drive to where something is seen as far as nothing stands in the way, and look. Returns the robot's last state."""
    if points := view.way[1:]:
        await _drive(link, points)
    return await look()


async def _drive(link: CommandLink, points: Sequence[Point]) -> None:
    """Drive through points, until something stays in the way. Raises RobotGaveUp if it cannot drive at all."""
    drive = asyncio.ensure_future(link.drive_along(points))
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
    finally:
        drive.cancel()


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

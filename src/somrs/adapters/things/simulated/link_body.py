"""A lift or a door of the simulator as the body of a controller: it is moved over the robot link, from outside of the simulation."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Mapping

from somrs.adapters.things.session_messages import Doors
from somrs.devices.link_security import link_credentials
from somrs.devices.simulator.link.commands import Command, ReleasePassage, ServePassage
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.link import RobotLink, link_address

log = logging.getLogger(__name__)

STANDING = 0.05
"""Difference in height up to which the cabin stands at a level, m."""
PAUSE = 1.0
"""Seconds after which a command that was given up is sent again."""


class LinkBody:
    """A passage of the simulator. `heights`: of a lift, those of the floors of its levels, m."""

    def __init__(self, link: RobotLink, heights: Mapping[str, float]) -> None:
        self._link, self._heights = link, dict(heights)
        self._work: asyncio.Task[None] | None = None
        self.doors: Doors = "closed"

    @property
    def level(self) -> str | None:
        state = self._link.state
        height = state.z if state is not None else None
        if height is None or not self._heights:
            return None
        return next((level for level, floor in self._heights.items() if abs(floor - height) < STANDING), None)

    @property
    def works(self) -> bool:
        state = self._link.state
        return self._link.connected and not self._link.silent and (state is None or not state.faults)

    def serve(self, level: str | None) -> None:
        self._begin(ServePassage(z=self._heights.get(level) if level is not None else None), "open")

    def release(self) -> None:
        self._begin(ReleasePassage(), "closed")

    def step(self, seconds: float) -> None:
        """Time passes in the simulator."""

    def _begin(self, command: Command, doors: Doors) -> None:
        if self._work is not None:
            self._work.cancel()
        self._work = asyncio.create_task(self._carry_out(command, doors))

    async def _carry_out(self, command: Command, doors: Doors) -> None:
        """Have a command carried out, again and again until it is."""
        self.doors, complaint = "moving", ""
        while True:
            try:
                await self._link.command(command)
            except RobotGaveUp as failure:
                if failure.description != complaint:
                    log.warning("%s", failure.description)
                complaint = failure.description
                await asyncio.sleep(PAUSE)
            else:
                self.doors = doors
                return


@contextlib.asynccontextmanager
async def link_body(name: str, heights: Mapping[str, float], simulator: str) -> AsyncIterator[LinkBody]:
    """The lift or the door of this name of the simulator at an address."""
    host, port, map = link_address(simulator)
    async with RobotLink(host, port, name, map=map, outside=True, credentials=link_credentials(simulator)) as link:
        yield LinkBody(link, heights)

"""The doors with a drive that a robot has opened while it explores, by tasks of its own, and closed again."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from somrs.devices.simulator.drivers.outage import Outage
from somrs.errors import RemoteError
from somrs.ontology.objects import Object
from somrs.protocol.messages.submission import Submit
from somrs.service_manager.sdk.map_reader import MapReader
from somrs.service_manager.sdk.tasks import TaskSubmitter
from somrs.service_manager.sdk.values import number_of
from somrs.sites.plan import Box

log = logging.getLogger(__name__)

POLL = 0.5
"""Seconds between two questions whether a door's task has ended."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DrivenDoor:
    """A door that opens when a task demands it: its name, and its rectangle on the map."""

    name: str
    box: Box


class Doors(Protocol):
    """The doors with a drive on the storey that is explored."""

    async def shut(self) -> Sequence[DrivenDoor]:
        """Those that are shut by the map as it is now."""

    async def open(self, name: str) -> bool:
        """Have a door opened. Returns whether it is open."""

    async def close(self, name: str) -> bool:
        """Have a door closed. Returns whether it is shut."""


class NoDoors:
    """A storey of which the map has no door with a drive."""

    async def shut(self) -> Sequence[DrivenDoor]:
        return ()

    async def open(self, name: str) -> bool:
        return False

    async def close(self, name: str) -> bool:
        return False


class DoorTasks:
    """Has the doors of a storey opened and closed by the Task Manager. `elevation`: of the storey, m; `tolerance`: how far the height of a
    door may be from it, m; `box_of`: the rectangle of an object."""

    def __init__(
        self, robot: str, map: MapReader, tasks: TaskSubmitter, elevation: float, tolerance: float, box_of: Callable[[Object], Box]
    ) -> None:
        self._robot, self._map, self._tasks = robot, map, tasks
        self._elevation, self._tolerance, self._box_of = elevation, tolerance, box_of
        self.opened: list[str] = []
        """Those that are open for the robot."""
        self.failed: list[str] = []
        """Those that could not be opened."""

    async def shut(self) -> Sequence[DrivenDoor]:
        try:
            rows = await self._map.query("?It: PoweredDoor.Open = FALSE AND ?It.PositionX = ?X AND ?It.PositionZ = ?Z")
            names = [str(row["It"]) for row in rows if abs(number_of(row["Z"]) - self._elevation) <= self._tolerance]
            objects = [await self._map.object(name) for name in names]
        except RemoteError as error:
            log.warning("%s cannot find out which doors are shut: %s", self._robot, error)
            return ()
        return [DrivenDoor(name=object.name, box=self._box_of(object)) for object in objects if object is not None]

    async def open(self, name: str) -> bool:
        self.opened.append(name)  # also if the robot is stopped meanwhile
        is_open = await self._have(f"{name}.Open = TRUE")
        if not is_open:
            self.opened.remove(name)
            self.failed.append(name)
        return is_open

    async def close(self, name: str) -> bool:
        self.opened.remove(name)
        return await self._have(f"{name}.Open = FALSE")

    async def leave(self) -> None:
        """Demand that what the robot has had opened be closed, without waiting for it."""
        for name in self.opened:
            try:
                await self._tasks.submit(Submit(effect=f"{name}.Open = FALSE"))
            except RemoteError as error:
                log.warning("%s cannot have %s closed: %s", self._robot, name, error)
        self.opened.clear()

    async def _have(self, effect: str) -> bool:
        """Submit a task, and wait until it has ended. Returns whether the effect is on the map then."""
        try:
            task = await self._tasks.submit(Submit(effect=effect, waits=False))
        except RemoteError as error:
            log.warning("%s cannot have %s: %s", self._robot, effect, error)
            return False
        outage, is_running = Outage(self._robot, f"find out whether {effect}"), True
        while is_running:
            await asyncio.sleep(POLL)
            with outage:
                is_running = await self._tasks.is_running(task)
        try:
            return await self._map.holds(effect)
        except RemoteError as error:
            log.warning("%s cannot find out whether %s: %s", self._robot, effect, error)
            return False

"""A robot of another make, whose hardware is a robot of the simulator that takes part in traffic from outside."""

from __future__ import annotations

import asyncio

from somrs.devices.link_security import link_credentials
from somrs.devices.road_robot import CarryingRobot, RobotFailed, Way
from somrs.devices.simulator.link.commands import RobotState
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.link import RobotLink, link_address

NEAR = 0.05
"""A robot that is this near to a waypoint has come to it, m."""


class OutsideRobot(CarryingRobot):
    """Drives with DriveAlong, and works with what is within reach."""

    can_charge = True

    async def open(self) -> None:
        host, port, map_name = link_address(self.simulator or "")
        credentials = link_credentials(self.simulator or "")
        self._told_way: Way = ()
        self._drive_task: asyncio.Task[None] | None = None
        self._body = RobotLink(host, port, self.name, on_state=self._heard, map=map_name, outside=True, credentials=credentials)
        await self._body.connect()
        await super().open()

    async def close(self) -> None:
        await super().close()
        await self._body.close()

    def _heard(self, state: RobotState) -> None:
        self.battery, self.holding = state.charge, state.holding
        self.located(state.x, state.y, state.yaw, state.z)
        for waypoint in self._told_way[1:]:
            if waypoint.released and abs(waypoint.x - state.x) < NEAR and abs(waypoint.y - state.y) < NEAR:
                self.passed(waypoint.number)

    async def follow(self, way: Way) -> None:
        released = [waypoint for waypoint in way[1:] if waypoint.released]
        if released and [w.number for w in released] != [
            w.number for w in self._told_way[1:] if w.released and w.number >= released[0].number
        ]:
            self._told_way = way
            if self._drive_task is not None:
                self._drive_task.cancel()
            self._drive_task = asyncio.create_task(self._drive([(w.x, w.y) for w in released], released[-1].yaw))
        self._told_way = way

    async def _drive(self, points: list[tuple[float, float]], yaw: float | None) -> None:
        try:
            await self._body.drive_along(points, yaw)
        except RobotGaveUp as failure:
            if failure.reason != "stopped":
                self.gave_up(failure.description)

    async def halt(self) -> None:
        if self._drive_task is not None:
            self._drive_task.cancel()
        await self._body.stop()
        self._told_way = ()

    async def pick(self, thing: str, support: str) -> None:
        await self._work(self._body.grip(thing))

    async def drop(self, thing: str, support: str) -> None:
        await self._work(self._body.place(support))

    async def charge_at(self, charger: str) -> None:
        await self._work(self._body.charge())

    async def interrupt(self) -> None:
        await self._body.stop()

    async def put_down(self, thing: str) -> tuple[float, float, float, str]:
        try:
            done = await self._body.put_down_object()
        except RobotGaveUp as failure:
            raise RobotFailed(failure.description) from None
        state = next(state for state in done.object_states if state.object == thing)
        return state.x, state.y, state.z, state.support or ""

    async def _work(self, command: object) -> None:
        try:
            await command  # type: ignore[misc]
        except RobotGaveUp as failure:
            raise RobotFailed(failure.description) from None

"""The body of a robot of the simulator, over its robot link."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping

from somrs.adapters.ros2.simulated.body import BodyFailed
from somrs.devices.link_security import link_credentials
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.link import OperatorLink, RobotLink, link_address

REACH = 1.0
"""How far from the robot's centre its gripper takes things, m."""
SUPPORT_REACH = 2.0
"""The same for the middle of a support, m."""
ASIDE, SUPPORT_ASIDE = math.radians(30), math.radians(80)
"""How far aside of where the robot looks a thing, and the middle of a support, may be, rad."""
THING_NUMBERS = 6
"""The numbers of a pose by which things are told from robots and doors."""


@contextlib.contextmanager
def _reasons() -> Iterator[None]:
    """Say for people why the robot gave up."""
    try:
        yield
    except RobotGaveUp as error:
        raise BodyFailed(error.description) from None


class LinkBody:
    """Drives a robot of the simulator. The robot takes part in traffic by its adapter: `outside` of the simulator.

    `simulator`: its address; `origin`: the pose of the robot's own map on that of the building, in which the body's poses are.
    """

    def __init__(self, simulator: str, robot: str, origin: tuple[float, float, float]) -> None:
        host, port, map_name = link_address(simulator)
        credentials = link_credentials(simulator)
        self._link = RobotLink(host, port, robot, map=map_name, outside=True, credentials=credentials)
        self._operator = OperatorLink(host, port, map_name, credentials)
        """Says where things are, which grippers find without names."""
        self._origin = origin

    async def open(self) -> None:
        """Connect, and wait for the robot's first state."""
        await self._link.connect()
        await self._operator.connect()
        await self._link.status()

    async def close(self) -> None:
        await self._operator.close()
        await self._link.close()

    @property
    def pose(self) -> tuple[float, float, float]:
        state, (x, y, yaw) = self._link.state, self._origin
        if state is None:
            return (0.0, 0.0, 0.0)
        dx, dy, cos, sin = state.x - x, state.y - y, math.cos(yaw), math.sin(yaw)
        return cos * dx + sin * dy, -sin * dx + cos * dy, math.remainder(state.yaw - yaw, math.tau)

    @property
    def moves(self) -> bool:
        return self._link.state is not None and self._link.state.activity == "DriveAlong"

    @property
    def battery(self) -> float:
        charge = self._link.state.charge if self._link.state is not None else None
        return charge / 100 if charge is not None else 1.0

    @property
    def holding(self) -> str | None:
        return self._link.state.holding if self._link.state is not None else None

    async def drive(self, x: float, y: float, yaw: float, speed: float | None) -> None:
        with _reasons():
            x0, y0, yaw0 = self._origin
            cos, sin = math.cos(yaw0), math.sin(yaw0)
            await self._link.drive_along([(x0 + cos * x - sin * y, y0 + sin * x + cos * y)], yaw0 + yaw, speed=speed)

    async def stop(self) -> None:
        with _reasons():
            await self._link.stop()

    async def take(self, thing: str | None) -> None:
        with _reasons():
            near = [thing] if thing is not None else self._ahead(await self._things(), REACH, ASIDE)
            if not near:
                raise BodyFailed("nothing is within reach")
            await self._link.grip(near[0])

    async def put(self, support: str | None) -> None:
        with _reasons():
            if support is not None:
                await self._link.place(support)
                return
            landmarks = (await self._link.sense(radius=SUPPORT_REACH)).object_states
            for name in self._ahead({mark.object: (mark.x, mark.y) for mark in landmarks}, SUPPORT_REACH, SUPPORT_ASIDE):
                with contextlib.suppress(RobotGaveUp):
                    await self._link.place(name)
                    return
            await self._link.put_down_object()

    async def _things(self) -> dict[str, tuple[float, float]]:
        """Where the things are, by name."""
        async with contextlib.aclosing(self._operator.poses(rate=10)) as news:
            async for poses in news:
                values = iter(poses.values)
                movers = [(mover, [next(values) for _ in range(mover.numbers)]) for mover in poses.movers or ()]
                return {mover.name: (pose[0], pose[1]) for mover, pose in movers if mover.numbers == THING_NUMBERS}
        return {}

    def _ahead(self, points: Mapping[str, tuple[float, float]], reach: float, aside: float) -> list[str]:
        """The objects in reach, those first that are straightest ahead."""
        state = self._link.state
        assert state is not None, "the body is open"
        bearings = {}
        for name, (x, y) in points.items():
            bearing = abs(math.remainder(math.atan2(y - state.y, x - state.x) - state.yaw, math.tau))
            if bearing < aside and math.dist((x, y), (state.x, state.y)) < reach:
                bearings[name] = bearing
        return sorted(bearings, key=lambda name: bearings[name])

    async def charge(self) -> None:
        with _reasons():
            await self._link.charge()

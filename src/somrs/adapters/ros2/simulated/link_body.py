"""The body of a robot of the simulator, over its robot link."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator

from somrs.adapters.ros2.simulated.body import BodyFailed
from somrs.devices.link_security import link_credentials
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.link import OperatorLink, RobotLink, link_address
from somrs.devices.simulator.link.reaching import put_ahead, things_ahead


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
            await self._link.grip(thing if thing is not None else await self._thing_ahead())

    async def put(self, support: str | None) -> None:
        with _reasons():
            await (self._link.place(support) if support is not None else put_ahead(self._link))

    async def _thing_ahead(self) -> str:
        """The thing that the gripper closes around. Raises BodyFailed if there is none."""
        state = self._link.state
        assert state is not None, "the body is open"
        near = things_ahead(state, await self._things())
        if not near:
            raise BodyFailed("nothing is within reach")
        return near[0]

    async def _things(self) -> dict[str, tuple[float, float]]:
        """The points of the things, by name."""
        async with contextlib.aclosing(self._operator.poses(rate=10)) as news:
            async for poses in news:
                values = iter(poses.values)
                movers = [(mover, [next(values) for _ in range(mover.numbers)]) for mover in poses.movers or ()]
                return {mover.name: (pose[0], pose[1]) for mover, pose in movers if mover.is_thing}
        return {}

    async def charge(self) -> None:
        with _reasons():
            await self._link.charge()

"""The body of a robot of the simulator, over its robot link."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from somrs.adapters.ros2.simulated.body import BodyFailed
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.link import RobotLink


@contextlib.contextmanager
def _reasons() -> Iterator[None]:
    """Say for people why the robot gave up."""
    try:
        yield
    except RobotGaveUp as error:
        raise BodyFailed(error.description) from None


class LinkBody:
    """Drives a robot of the simulator. The robot takes part in traffic by its adapter: `outside` of the simulator."""

    def __init__(self, host: str, port: int, robot: str) -> None:
        self._link = RobotLink(host, port, robot, outside=True)

    async def open(self) -> None:
        """Connect, and wait for the robot's first state."""
        await self._link.connect()
        await self._link.status()

    async def close(self) -> None:
        await self._link.close()

    @property
    def pose(self) -> tuple[float, float, float]:
        state = self._link.state
        return (state.x, state.y, state.yaw) if state is not None else (0.0, 0.0, 0.0)

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
            await self._link.drive_along([(x, y)], yaw, speed=speed)

    async def stop(self) -> None:
        with _reasons():
            await self._link.stop()

    async def take(self, thing: str | None) -> None:
        if thing is None:
            raise BodyFailed("the simulator is told which thing to grip")
        with _reasons():
            await self._link.grip(thing)

    async def put(self, support: str | None) -> None:
        with _reasons():
            await (self._link.place(support) if support is not None else self._link.put_down_object())

    async def charge(self) -> None:
        with _reasons():
            await self._link.charge()

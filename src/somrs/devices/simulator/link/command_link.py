"""What a driver has its robot do: commands, which a link carries out. One kind of link leads to a robot of the simulator, another to one
that drives on the ways that traffic grants it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from types import TracebackType
from typing import Self

from somrs.devices.simulator.link.commands import (
    Approach,
    Charge,
    Close,
    Command,
    CommandDone,
    DriveAlong,
    DriveTo,
    Grip,
    Insert,
    Likeness,
    LookAround,
    LookAt,
    MoveCabin,
    Open,
    Place,
    Point,
    PutDown,
    RobotState,
    Scan,
    Sense,
    Status,
    Stop,
    Velocity,
    Weigh,
)
from somrs.devices.simulator.link.lines import Legs, PathStop


class CommandLink(ABC):
    """Carries out the commands to one robot or camera. They return `CommandDone` or raise RobotGaveUp. A new command ends the one in
    progress."""

    silent: bool = False
    """Whether nothing has been heard of the robot for too long."""

    @abstractmethod
    async def __aenter__(self) -> Self: ...

    @abstractmethod
    async def __aexit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None: ...

    @property
    @abstractmethod
    def state(self) -> RobotState | None:
        """The last state that the robot reported."""

    @property
    @abstractmethod
    def connected(self) -> bool:
        """Whether the robot can be told anything now."""

    @abstractmethod
    async def wait_reconnected(self, timeout: float) -> bool:
        """Wait for a reconnection until `timeout` seconds after the connection was lost. Return whether the link is connected."""

    @abstractmethod
    async def command(self, command: Command) -> CommandDone:
        """Have a command carried out, and wait for its result. Raises RobotGaveUp, at once if the robot is silent."""

    @abstractmethod
    async def legs(self, *stops: PathStop, situation: str | None = None) -> Legs:
        """The way through the stops in a situation (what others will have changed, in Entish), and the shut doors on it."""

    async def ways(self, *stops: str | tuple[float, float]) -> tuple[float | None, ...]:
        """Driving distances in metres to the first stop, from there to the next, and so on; None where there is no path."""
        legs = await self.legs(*stops)
        return legs.lengths if not legs.shut else (None,) * len(stops)

    async def drive_to(self, x: float, y: float, yaw: float | None = None, z: float | None = None) -> CommandDone:
        return await self.command(DriveTo(x=x, y=y, yaw=yaw, z=z))

    async def drive_along(
        self, points: Sequence[tuple[float, float]], yaw: float | None = None, *, speed: float | None = None, backward: bool = False
    ) -> CommandDone:
        return await self.command(DriveAlong(points=tuple(points), yaw=yaw, speed=speed, backward=backward))

    async def set_velocity(self, forward: float, turning: float, lasts: float = 0.5) -> CommandDone:
        return await self.command(Velocity(forward=forward, turning=turning, lasts=lasts))

    async def approach(self, object: str) -> CommandDone:
        return await self.command(Approach(object=object))

    async def grip(self, object: str) -> CommandDone:
        return await self.command(Grip(object=object))

    async def place(self, support: str, x: float | None = None, y: float | None = None) -> CommandDone:
        return await self.command(Place(support=support, x=x, y=y))

    async def insert(self, container: str) -> CommandDone:
        return await self.command(Insert(container=container))

    async def open_doors(self, object: str) -> CommandDone:
        return await self.command(Open(object=object))

    async def close_doors(self, object: str) -> CommandDone:
        return await self.command(Close(object=object))

    async def move_cabin(self, z: float) -> CommandDone:
        return await self.command(MoveCabin(z=z))

    async def charge(self) -> CommandDone:
        return await self.command(Charge())

    async def put_down_object(self) -> CommandDone:
        return await self.command(PutDown())

    async def weigh(self, object: str) -> CommandDone:
        return await self.command(Weigh(object=object))

    async def sense(
        self, radius: float | None = None, like: Likeness | None = None, expected: Sequence[Point] = (), *, furniture: bool = False
    ) -> CommandDone:
        return await self.command(Sense(radius=radius, like=like, expected=tuple(expected), furniture=furniture))

    async def scan(self, scan: Scan) -> CommandDone:
        return await self.command(scan)

    async def look_at(
        self, x: float, y: float, z: float, object: str | None = None, like: Likeness | None = None, *, whole: bool = False
    ) -> CommandDone:
        return await self.command(LookAt(x=x, y=y, z=z, object=object, like=like, whole=whole))

    async def look_around(self, object: str | None = None, like: Likeness | None = None, *, whole: bool = False) -> CommandDone:
        return await self.command(LookAround(object=object, like=like, whole=whole))

    async def stop(self) -> CommandDone:
        return await self.command(Stop())

    async def status(self) -> CommandDone:
        return await self.command(Status())

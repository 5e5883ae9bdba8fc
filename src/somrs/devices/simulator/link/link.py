"""The client's side of the robot link: `RobotLink` for the program that controls a robot, `OperatorLink` for the operator of the simulator.
Both reconnect when the connection is lost.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass

from somrs.devices.link_security import SCHEME, link_credentials
from somrs.devices.simulator.link.command_link import CommandLink
from somrs.devices.simulator.link.commands import (
    Command,
    CommandDone,
    Fault,
    LinkedDevice,
    ObjectState,
    RobotState,
)
from somrs.devices.simulator.link.connection import Link, RobotGaveUp
from somrs.devices.simulator.link.lines import (
    HEARTBEAT,
    VERSION,
    Ask,
    Break,
    Clock,
    Devices,
    Follow,
    Hello,
    Idle,
    Legs,
    Look,
    Move,
    Order,
    OrderDone,
    OrderGivenUp,
    PathStop,
    Picture,
    Poses,
    Refused,
    Repair,
    Roads,
    Robots,
    ServerLine,
    SetWeight,
    State,
    Traffic,
    Unheard,
    encode_line,
)
from somrs.devices.simulator.link.pose_buffer import PoseBuffer
from somrs.devices.simulator.link.roads import Roadmap, TrafficState
from somrs.errors import UsageError
from somrs.trust.credentials import Credentials

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """The simulated time in seconds, and its speed in simulated seconds per second; None: as fast as the processor allows."""

    time: float
    speed: float | None


def link_address(address: str) -> tuple[str, int, str | None]:
    """Host, port and map of a simulator's address: `host:port`, or `host:port/map` for a world with several maps; before it `tls://`, if it
    has certificates. Raises UsageError."""
    socket, _, map = address.removeprefix(SCHEME).partition("/")
    host, _, port = socket.rpartition(":")
    if not host or not port.isdigit():
        raise UsageError(f"the address of a simulator is host:port, or host:port/map for a world with several maps, not {address!r}")
    return host, int(port), map or None


class RobotLink(Link, CommandLink):
    """Controls one robot or camera. Commands return `CommandDone` or raise RobotGaveUp. A new command ends the one in progress.

    `outside`: see `Hello`. `on_state` is called with every state. When the simulator has run for `silence` seconds without a line from
    the robot, pending commands fail. Time in which this program or the simulator was suspended does not count.
    """

    def __init__(
        self,
        host: str,
        port: int,
        robot: str,
        *,
        rate: float = 10.0,
        silence: float = 6.0,
        on_state: Callable[[RobotState], None] | None = None,
        map: str | None = None,
        outside: bool = False,
        credentials: Credentials | None = None,
    ) -> None:
        super().__init__(host, port, Hello(version=VERSION, robot=robot, rate=rate, map=map, outside=outside), credentials)
        self.robot = robot
        self._silence = silence
        self._unheard = 0.0
        self._state: RobotState | None = None
        self.silent = False
        """Whether the robot has sent nothing for `silence` seconds."""
        self._on_state = on_state

    @property
    def state(self) -> RobotState | None:
        return self._state

    @property
    def connected(self) -> bool:
        return self._ready.is_set()

    async def wait_reconnected(self, timeout: float) -> bool:
        """Wait for a reconnection until `timeout` seconds after the connection was lost. Return whether the link is connected."""
        remaining = self._lost_at + timeout - asyncio.get_running_loop().time()
        if not self.connected and remaining > 0:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(remaining):
                    await self._ready.wait()
        return self.connected

    async def command(self, command: Command) -> CommandDone:
        """Send a command, and wait for its result. Raises RobotGaveUp, at once if the robot is silent."""
        if self.silent:
            raise RobotGaveUp("silent", f"{self.robot} has sent nothing for {self._silence:g} s", self.state)
        match await self._exchange(lambda id: Order(id=id, command=command)):
            case OrderDone() as done:
                return CommandDone(
                    state=done.state, object_states=done.object_states, sightings=done.sightings, clear=done.clear, ranges=done.ranges
                )
            case OrderGivenUp(reason=reason, description=description, state=state, object_states=object_states):
                raise RobotGaveUp(reason, description, state, object_states)
            case Refused(description=description):
                raise RobotGaveUp("refused", description, self.state)
            case reply:
                raise RobotGaveUp("refused", f"{self._address} answered a command with {type(reply).__name__}", self.state)

    async def legs(self, *stops: PathStop, situation: str | None = None) -> Legs:
        return await self._legs(self.robot, stops, situation)

    def _hear(self, line: ServerLine) -> None:
        if isinstance(line, Unheard):
            self._unheard += HEARTBEAT
            if self._unheard >= self._silence and not self.silent:
                self._fall_silent()
            return
        if isinstance(line, State | OrderDone | OrderGivenUp):
            self.silent, self._unheard = False, 0.0
            self._state = line.state
            if self._on_state is not None:
                self._on_state(line.state)
        super()._hear(line)

    def _fall_silent(self) -> None:
        description = f"{self.robot} has sent nothing for {self._silence:g} s"
        self.silent = True
        log.warning("%s", description)
        self._fail_all("silent", description)

    def _last_state(self) -> RobotState | None:
        return self.state


class OperatorLink(Link):
    """Observes the simulated world, and intervenes in it. Methods raise UsageError when the simulator refuses a request."""

    def __init__(self, host: str, port: int, map: str | None = None, credentials: Credentials | None = None) -> None:
        super().__init__(host, port, Hello(version=VERSION, map=map), credentials)
        self._pose_buffer: PoseBuffer | None = None

    @classmethod
    def at(cls, address: str, credentials: Credentials | None = None) -> OperatorLink:
        """A link to the simulator at an address of a system, as of `link_address`. `credentials`: by default those of this process.

        Raises UsageError.
        """
        return cls(*link_address(address), link_credentials(address, credentials))

    async def fault(self, robot: str, fault: Fault) -> None:
        """Inject a fault now."""
        await self._ask(Break(robot=robot, fault=fault))

    async def schedule(
        self, robot: str, fault: Fault, *, delay: float | None = None, carried: float | None = None, released: bool = False
    ) -> None:
        """Schedule a fault: after `delay` simulated seconds, when the robot has `carried` something for so many metres, or a lift a robot,
        or when it has `released` what it carried. Raises UsageError if none of these is given."""
        if delay is None and carried is None and not released:
            raise UsageError(
                "give the time of the fault: `delay` in seconds, `carried` in metres that the robot carries something, "
                "or `released` for when it has released something"
            )
        await self._ask(Break(robot=robot, fault=fault, delay=delay, carried=carried, released=released))

    async def repair(self, robot: str, fault: Fault) -> None:
        await self._ask(Repair(robot=robot, fault=fault))

    async def observe(self, object: str) -> ObjectState:
        """The true pose of an object."""
        object_state = (await self._ask(Look(object=object))).object_state
        assert object_state is not None, "the answer to `look`"
        return object_state

    async def robots(self) -> dict[str, RobotState]:
        return (await self._ask(Robots())).robots or {}

    async def devices(self) -> dict[str, LinkedDevice]:
        """Everything with a robot link: robots, cameras, scales, lifts and doors with a drive."""
        return (await self._ask(Devices())).devices or {}

    async def roadmap(self) -> Roadmap:
        """The roadmap, and what of it is closed now."""
        roadmap = (await self._ask(Roads())).roadmap
        assert roadmap is not None, "the answer to `roads`"
        return roadmap

    async def traffic(self) -> TrafficState:
        """Where the robots may drive, and whom they wait for."""
        traffic = (await self._ask(Traffic())).traffic
        assert traffic is not None, "the answer to `traffic`"
        return traffic

    async def clock(self) -> Reading:
        answer = await self._ask(Clock())
        assert answer.time is not None, "the answer to `clock`"
        return Reading(time=answer.time, speed=answer.speed)

    async def picture(
        self, subject: str | None = None, *, width: int = 1200, robot: str | None = None, carried: float | None = None
    ) -> bytes:
        """A PNG of the world, of a storey, or of an object and its surroundings. Raises SimulationError when there is no OpenGL.

        `width`: in pixels; the height is 3/4 of it. With `robot` and `carried`, waits until the robot has carried an object for so many
        metres, or a lift a robot; 0: until it holds one.
        """
        return (await self._ask(Picture(subject=subject, width=width, robot=robot, carried=carried))).png or b""

    async def ways(self, robot: str, *stops: str | tuple[float, float]) -> tuple[float | None, ...]:
        """Driving distances in metres to the first stop, from there to the next, and so on; None where there is no path."""
        return (await self._legs(robot, stops, None)).lengths

    async def idle(self) -> None:
        """Wait until all robots are idle."""
        await self._ask(Idle())

    async def move(self, object: str, x: float, y: float, z: float, yaw: float = 0.0) -> None:
        """Move an object to another pose without a robot."""
        await self._ask(Move(object=object, x=x, y=y, z=z, yaw=yaw))

    async def set_weight(self, object: str, weight: float) -> None:
        """Give an object another weight in kg, of which the map does not learn."""
        await self._ask(SetWeight(object=object, weight=weight))

    async def poses(self, rate: float = 20.0) -> AsyncGenerator[Poses, None]:
        """Yield the poses of everything that can move, then the changes. The first line has the `movers`. A slow caller gets merged lines.

        Raises: RobotGaveUp when the connection is lost; call it again then. UsageError if another subscription is active on this link.
        """
        if self._pose_buffer is not None:
            raise UsageError("this link already has a subscription to poses; connect another link")
        await self._wait_connected()
        pose_buffer = self._pose_buffer = PoseBuffer()
        try:
            await self._ask(Follow(rate=rate))
            while True:
                yield await pose_buffer.next_poses()
        finally:
            self._pose_buffer = None
            if self._writer is not None:
                self._writer.write(encode_line(Ask(id=next(self._ids), question=Follow(rate=0))))

    def _hear(self, line: ServerLine) -> None:
        if isinstance(line, Poses):
            if self._pose_buffer is not None:
                self._pose_buffer.add_line(line)
            return
        super()._hear(line)

    def _fail_all(self, reason: str, description: str) -> None:
        super()._fail_all(reason, description)
        if self._pose_buffer is not None:
            self._pose_buffer.fail(RobotGaveUp(reason, description))

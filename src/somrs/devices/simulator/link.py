"""The client's side of the robot link: `RobotLink` for the program that controls a robot, `OperatorLink` for whoever runs the
simulator. Both find the server again when the connection is lost.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
import math
from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from somrs.devices.simulator.commands import (
    Approach,
    Command,
    Done,
    DriveTo,
    Fault,
    Grip,
    LookAround,
    LookAt,
    Place,
    PutDown,
    RobotState,
    Seen,
    Sense,
    Status,
    Stop,
)
from somrs.devices.simulator.following import Following
from somrs.devices.simulator.lines import (
    VERSION,
    Answer,
    Ask,
    Break,
    ClientLine,
    Clock,
    Follow,
    Hello,
    Idle,
    Look,
    Move,
    Order,
    OrderDone,
    OrderGivenUp,
    Picture,
    Poses,
    Question,
    Refused,
    Repair,
    Robots,
    ServerLine,
    State,
    Through,
    Ways,
    Welcome,
    read_by_client,
    written,
)
from somrs.errors import RemoteError, SimulationError, UsageError, WireError

log = logging.getLogger(__name__)

LONGEST = 64 * 1024 * 1024
"""Bytes of the longest line that a client reads: a picture is one line."""
PATIENCE = 10.0
"""Seconds for which a connection may take to be made, and for which commands wait for a lost one to come back."""
PAUSES = (0.1, 0.2, 0.5, 1.0, 2.0)
"""Seconds before each attempt to connect again; the last one goes on."""
FINAL = {"version", "unknown-robot", "hello-first"}
"""Reasons of a refusal that will not pass by themselves."""


class RobotGaveUp(RemoteError):
    """A command was not carried out. `reason` is one of those of `Gave`, or `link-lost`, `silent` or `refused`.

    `state` and `seen` are what the robot said last, or None and nothing.
    """

    def __init__(self, reason: str, description: str, state: RobotState | None = None, seen: tuple[Seen, ...] = ()) -> None:
        self.reason, self.description, self.state, self.seen = reason, description, state, seen
        super().__init__(reason, description)

    def __str__(self) -> str:
        return self.description


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What the simulated clock says, and how fast it goes: simulated seconds per second, None for as fast as it can."""

    time: float
    speed: float | None


class _Link:
    """A connection that is made again when it is lost, and what was said on it that has no answer yet."""

    def __init__(self, host: str, port: int, hello: Hello, silence: float | None) -> None:
        self._where = f"{host}:{port}"
        self._host, self._port, self._hello, self._silence = host, port, hello, silence
        self._ids = itertools.count(1)
        self._unanswered: dict[int, asyncio.Future[ServerLine]] = {}
        self._writer: asyncio.StreamWriter | None = None
        self._ready = asyncio.Event()
        self._keeping: asyncio.Task[None] | None = None
        self._refusal: Refused | None = None
        self._lost_at = -math.inf

    async def connect(self) -> None:
        """Connect. Raises RemoteError when that is refused, or not possible for some time."""
        self._keeping = asyncio.create_task(self._keep())
        try:
            await self._connected()
        except BaseException:  # cancelled, too: nobody would close the connection otherwise
            await self.close()
            raise

    async def close(self) -> None:
        if self._keeping is not None:
            self._keeping.cancel()
            await asyncio.wait({self._keeping})
            self._keeping = None

    async def __aenter__(self) -> Self:
        await self.connect()
        return self

    async def __aexit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        await self.close()

    async def _connected(self) -> None:
        """Wait until there is a connection."""
        if self._keeping is None:
            raise UsageError("the link is not connected; call connect() first, or use `async with`")
        ready = asyncio.ensure_future(self._ready.wait())
        try:
            await asyncio.wait({ready, self._keeping}, timeout=PATIENCE, return_when=asyncio.FIRST_COMPLETED)
        finally:
            ready.cancel()
        if self._ready.is_set():
            return
        if self._refusal is not None:
            raise RobotGaveUp("refused", f"{self._where}: {self._refusal.description}")
        raise RobotGaveUp("link-lost", f"there is no connection to {self._where}; is the simulator running?")

    async def _say(self, make: Callable[[int], ClientLine]) -> ServerLine:
        """Say something with an id, and wait for the answer."""
        await self._connected()
        assert self._writer is not None, "there is a connection"
        id = next(self._ids)
        answer: asyncio.Future[ServerLine] = asyncio.get_running_loop().create_future()
        self._unanswered[id] = answer
        try:
            self._writer.write(written(make(id)))
            return await answer
        finally:
            self._unanswered.pop(id, None)

    async def _keep(self) -> None:
        """Connect, listen, and begin again when the connection is lost."""
        pauses = iter(PAUSES)
        while True:
            try:
                if await self._converse():
                    pauses = iter(PAUSES)
            except (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError) as error:
                log.debug("%s: %s", self._where, error)
            except WireError as error:
                log.warning("%s: %s", self._where, error)
            finally:
                was_ready = self._ready.is_set()
                self._ready.clear()
                if was_ready:
                    self._lost_at = asyncio.get_running_loop().time()
                self._fail_all("link-lost", f"the connection to {self._where} was lost")
                if self._writer is not None:
                    self._writer.close()
                    self._writer = None
            if was_ready:
                log.warning("the connection to %s was lost; it is being made again", self._where)
            if self._refusal is not None and self._refusal.reason in FINAL:
                return
            await asyncio.sleep(next(pauses, PAUSES[-1]))

    async def _converse(self) -> bool:
        """Listen until the connection ends. Whether it was accepted."""
        async with asyncio.timeout(PATIENCE):
            reader, self._writer = await asyncio.open_connection(self._host, self._port, limit=LONGEST)
            self._writer.write(written(self._hello))
            first = read_by_client(await reader.readuntil(b"\n"))
        if isinstance(first, Refused):
            self._refusal = first
            return False
        if not isinstance(first, Welcome):
            raise WireError("malformed", f"the first line has to be a welcome or an error, not {type(first).__name__}")
        self._refusal = None
        self._ready.set()
        while True:
            try:
                async with asyncio.timeout(self._silence):
                    line = await reader.readuntil(b"\n")
            except TimeoutError:
                self._fail_all("silent", f"{self._hello.robot or self._where} has said nothing for {self._silence:g} s")
                self._fell_silent()
                line = await reader.readuntil(b"\n")
            except asyncio.IncompleteReadError:
                return True
            self._hear(read_by_client(line))

    def _hear(self, line: ServerLine) -> None:
        if isinstance(line, OrderDone | OrderGivenUp | Answer | Refused) and line.id is not None:
            waiting = self._unanswered.get(line.id)
            if waiting is not None and not waiting.done():
                waiting.set_result(line)
        elif isinstance(line, Refused):
            self._refusal = line
            log.warning("%s: %s", self._where, line.description)

    def _fell_silent(self) -> None:
        """Called when nothing was heard for too long."""

    def _fail_all(self, reason: str, description: str) -> None:
        for waiting in self._unanswered.values():
            if not waiting.done():
                waiting.set_exception(RobotGaveUp(reason, description, self._last_state()))

    def _last_state(self) -> RobotState | None:
        return None


class RobotLink(_Link):
    """Controls one robot, or speaks with a camera. Commands return `Done`, or raise RobotGaveUp; one that follows another ends that one.

    `on_state` is called with every state. After `silence` seconds without any word what waits for an answer fails.
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
    ) -> None:
        super().__init__(host, port, Hello(version=VERSION, robot=robot, rate=rate), silence)
        self.robot = robot
        self.state: RobotState | None = None
        """The latest that the robot said of itself."""
        self.silent = False
        """It has said nothing for too long."""
        self._on_state = on_state

    @property
    def connected(self) -> bool:
        return self._ready.is_set()

    async def back(self, within: float) -> bool:
        """Whether it is connected. Until so many seconds after the connection was lost, it is waited for."""
        left = self._lost_at + within - asyncio.get_running_loop().time()
        if not self.connected and left > 0:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._ready.wait(), left)
        return self.connected

    async def drive_to(self, x: float, y: float, yaw: float | None = None) -> Done:
        return await self.command(DriveTo(x=x, y=y, yaw=yaw))

    async def approach(self, object: str) -> Done:
        return await self.command(Approach(object=object))

    async def grip(self, object: str) -> Done:
        return await self.command(Grip(object=object))

    async def place(self, on: str, x: float | None = None, y: float | None = None) -> Done:
        return await self.command(Place(on=on, x=x, y=y))

    async def put_down(self) -> Done:
        return await self.command(PutDown())

    async def sense(self, radius: float | None = None) -> Done:
        return await self.command(Sense(radius=radius))

    async def look_at(self, x: float, y: float, z: float, object: str | None = None) -> Done:
        return await self.command(LookAt(x=x, y=y, z=z, object=object))

    async def look_around(self, object: str | None = None) -> Done:
        return await self.command(LookAround(object=object))

    async def stop(self) -> Done:
        return await self.command(Stop())

    async def status(self) -> Done:
        return await self.command(Status())

    async def command(self, command: Command) -> Done:
        """Have the robot carry out a command. One that has fallen silent is not waited for."""
        if self.silent:
            raise RobotGaveUp("silent", f"{self.robot} has said nothing for {self._silence:g} s", self.state)
        match await self._say(lambda id: Order(id=id, command=command)):
            case OrderDone(state=state, seen=seen):
                return Done(state=state, seen=seen)
            case OrderGivenUp(reason=reason, description=description, state=state, seen=seen):
                raise RobotGaveUp(reason, description, state, seen)
            case Refused(description=description):
                raise RobotGaveUp("refused", description, self.state)
            case other:
                raise RobotGaveUp("refused", f"{self._where} answered a command with {type(other).__name__}", self.state)

    async def ways(self, *through: str | tuple[float, float]) -> tuple[float | None, ...]:
        """Metres that the robot would have to drive to get to the first, from there to the next, and so on."""
        return await _ways(self, self.robot, through)

    def _hear(self, line: ServerLine) -> None:
        self.silent = False
        if isinstance(line, State | OrderDone | OrderGivenUp):
            self.state = line.state
            if self._on_state is not None:
                self._on_state(line.state)
        super()._hear(line)

    def _fell_silent(self) -> None:
        self.silent = True
        log.warning("%s has said nothing for %g s", self.robot, self._silence)

    def _last_state(self) -> RobotState | None:
        return self.state


class OperatorLink(_Link):
    """Looks into the simulator, and intervenes. Raises UsageError for what the simulator cannot do as asked."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__(host, port, Hello(version=VERSION), silence=None)
        self._following: Following | None = None

    async def fault(self, robot: str, fault: Fault) -> None:
        """Break something now."""
        await _answer(self, Break(robot=robot, fault=fault))

    async def schedule(self, robot: str, fault: Fault, *, after: float | None = None, carried: float | None = None) -> None:
        """Break something after so many simulated seconds, or when the robot has carried something so many metres."""
        if after is None and carried is None:
            raise UsageError("say when the fault is to happen: after how many seconds, or when the robot has carried something how far")
        await _answer(self, Break(robot=robot, fault=fault, after=after, carried=carried))

    async def repair(self, robot: str, fault: Fault) -> None:
        await _answer(self, Repair(robot=robot, fault=fault))

    async def seen(self, object: str) -> Seen:
        """Where an object truly is."""
        seen = (await _answer(self, Look(object=object))).seen
        assert seen is not None, "the answer to `look`"
        return seen

    async def robots(self) -> dict[str, RobotState]:
        return (await _answer(self, Robots())).robots or {}

    async def clock(self) -> Reading:
        answer = await _answer(self, Clock())
        assert answer.time is not None, "the answer to `clock`"
        return Reading(time=answer.time, speed=answer.speed)

    async def picture(self, subject: str | None = None) -> bytes:
        """A PNG of the world, or of an object and what is around it. Raises SimulationError when there is no OpenGL."""
        return (await _answer(self, Picture(subject=subject))).png or b""

    async def ways(self, robot: str, *through: str | tuple[float, float]) -> tuple[float | None, ...]:
        """Metres that the robot would have to drive to get to the first, from there to the next, and so on."""
        return await _ways(self, robot, through)

    async def idle(self) -> None:
        """Return when no robot does anything any more."""
        await _answer(self, Idle())

    async def move(self, object: str, x: float, y: float, z: float, yaw: float = 0.0) -> None:
        """Put an object elsewhere, by magic."""
        await _answer(self, Move(object=object, x=x, y=y, z=z, yaw=yaw))

    async def poses(self, rate: float = 20.0) -> AsyncGenerator[Poses, None]:
        """Where everything is that can move, and then what moves of it, as it moves: the first has the `movers`. One who is slow to take
        them gets fewer. Raises RobotGaveUp when the connection is lost; what follows it then begins anew."""
        if self._following is not None:
            raise UsageError("the poses are followed already on this link; connect another one")
        await self._connected()
        following = self._following = Following()
        try:
            await _answer(self, Follow(rate=rate))
            while True:
                yield await following.next()
        finally:
            self._following = None
            if self._writer is not None:
                self._writer.write(written(Ask(id=next(self._ids), question=Follow(rate=0))))

    def _hear(self, line: ServerLine) -> None:
        if isinstance(line, Poses):
            if self._following is not None:
                self._following.put(line)
            return
        super()._hear(line)

    def _fail_all(self, reason: str, description: str) -> None:
        super()._fail_all(reason, description)
        if self._following is not None:
            self._following.fail(RobotGaveUp(reason, description))


async def _answer(link: _Link, question: Question) -> Answer:
    match await link._say(lambda id: Ask(id=id, question=question)):
        case Answer() as answer:
            return answer
        case Refused(reason="no-graphics", description=description):
            raise SimulationError(description)
        case Refused(description=description):
            raise UsageError(description)
        case other:
            raise RemoteError(f"a question was answered with {type(other).__name__}")


async def _ways(link: _Link, robot: str, through: Through) -> tuple[float | None, ...]:
    return (await _answer(link, Ways(robot=robot, through=through))).lengths or ()

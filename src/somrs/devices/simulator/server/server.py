"""Hosts a simulation: advances its time, and serves the connections of robots and operators with the lines of `lines.py`.

One task steps the physics, in slices so short that the sockets are served in time. While nothing moves, it does not step the physics, and
the processor idles.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from dataclasses import dataclass

from somrs.devices.simulator.link.commands import CommandDone, CommandGivenUp, Fault, RobotState, Stop
from somrs.devices.simulator.link.lines import (
    HEARTBEAT,
    LONGEST,
    PROTOCOL,
    VERSION,
    Answer,
    Ask,
    Break,
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
    Question,
    Refused,
    Repair,
    Robots,
    ServerLine,
    State,
    Unheard,
    Ways,
    Welcome,
    encode_line,
    read_by_server,
    read_opening,
)
from somrs.devices.simulator.server.driving_distances import leg_lengths
from somrs.devices.simulator.server.faults import Schedule
from somrs.devices.simulator.server.poses import PoseSubscription, Table, is_same_state, robot_statuses
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.camera import Camera, close_up
from somrs.errors import SimulationError, UsageError, WireError
from somrs.ports import bound

log = logging.getLogger(__name__)

TICK = 0.002
"""Shortest time in seconds for the sockets between two slices of physics; the event loop waits in milliseconds."""
SLICE = 0.004
"""Longest time in seconds for which a slice of physics may delay the sockets."""
MAX_LAG = 0.2
"""Largest lag in seconds of simulated time behind real time that is caught up; a larger lag is dropped."""
NAP = 0.05
"""Seconds between two checks of a world at rest, in real-time mode."""
MOST_STATES = 50.0
"""Largest number of state lines per second for a connection."""
SLOW_READER, TOO_SLOW_READER = 256 * 1024, 16 * 1024 * 1024
"""Bytes not yet read by a client, above which it receives no states, and above which its connection is aborted."""


@dataclass(slots=True, eq=False)
class _Session:
    """One connection. `robot`: the robot that it controls; None for an operator."""

    writer: asyncio.StreamWriter
    robot: str | None = None
    rate: float = 0.0
    next_state_time: float = 0.0
    """In simulated time, s."""
    last_state_time: float = 0.0
    """In real time, by the monotonic clock, s."""
    reported_state: RobotState | None = None
    """The state that was sent last."""

    def send_line(self, line: ServerLine) -> None:
        if self.writer.transport.get_write_buffer_size() > TOO_SLOW_READER:
            self.writer.transport.abort()
        elif not self.writer.transport.is_closing():
            self.writer.write(encode_line(line))

    @property
    def slow(self) -> bool:
        return self.writer.transport.get_write_buffer_size() > SLOW_READER


class _Closing(Exception):
    """Ends the connection after sending `line`."""

    def __init__(self, reason: str, description: str) -> None:
        self.line = Refused(reason=reason, description=description)
        super().__init__(reason)


class Server:
    """Serves the simulation at a TCP port. `speed`: simulated seconds per second; None: as fast as the processor allows."""

    def __init__(self, simulation: Simulation, *, host: str = "127.0.0.1", port: int = 0, speed: float | None = None) -> None:
        self.simulation, self.host, self.port, self.speed = simulation, host, port, speed
        self._schedule = Schedule(simulation)
        self._sessions: set[_Session] = set()
        self._controllers: dict[str, _Session] = {}
        self._waiting: list[tuple[_Session, int]] = []
        self._wake = asyncio.Event()
        self._camera: Camera | None = None
        self._followers: dict[_Session, PoseSubscription] = {}
        self._table: Table | None = None

    async def start(self) -> None:
        """Listen, start the simulated time, and set `port` to the actual port."""
        self._listener = await asyncio.start_server(self._serve, sock=bound(self.host, self.port), limit=LONGEST)
        self.port = self._listener.sockets[0].getsockname()[1]
        self._running = asyncio.create_task(self._run())

    async def ended(self) -> None:
        """Wait until the simulation ends. Raises SimulationError if it failed."""
        await asyncio.shield(self._running)

    async def stop(self) -> None:
        """End all connections. Raises the SimulationError that ended the simulation, if one did."""
        self._listener.close()
        self._running.cancel()
        for session in list(self._sessions):
            session.writer.close()
        if self._camera is not None:
            self._camera.close()
        await asyncio.wait({self._running})
        if not self._running.cancelled():
            self._running.result()

    # Time

    async def _run(self) -> None:
        try:
            await (self._run_fast() if self.speed is None else self._run_at(self.speed))
        except SimulationError as error:
            log.critical("%s", error)
            self._listener.close()
            for session in list(self._sessions):
                session.send_line(Refused(reason="failed", description=str(error)))
                session.writer.close()
            raise

    async def _run_fast(self) -> None:
        while True:
            if self.simulation.busy:
                self._step_for(SLICE)
                await asyncio.sleep(0)
                continue
            self._tell_poses(time.monotonic(), at_rest=True)
            self._tell_waiting()
            self._tell_states()
            await self._nap(HEARTBEAT / 2)

    async def _run_at(self, speed: float) -> None:
        start_time, origin = time.monotonic(), self.simulation.time
        while True:
            lag = (time.monotonic() - start_time) * speed + origin - self.simulation.time
            if resting := lag > 0 and self.simulation.rest(self.simulation.time + lag):
                self._break_due()
            elif lag > 0:
                if lag > MAX_LAG * speed:
                    start_time, origin = time.monotonic(), self.simulation.time
                self._step_for(SLICE, until_time=self.simulation.time + lag)
            self._tell_states()
            if self._waiting and not self.simulation.busy:
                self._tell_poses(time.monotonic(), at_rest=True)
                self._tell_waiting()
            if resting:
                await self._nap(NAP)
            else:
                await asyncio.sleep(max(TICK, (self.simulation.time - origin) / speed - (time.monotonic() - start_time)))

    async def _nap(self, seconds: float) -> None:
        """Wait for a line from a client, but at most for `seconds`, because the map may change, too."""
        self._wake.clear()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._wake.wait()

    def _step_for(self, seconds: float, until_time: float = float("inf")) -> None:
        """Step the physics for `seconds` of real time, but not beyond `until_time` in simulated time."""
        end = time.monotonic() + seconds
        while self.simulation.time < until_time:
            self.simulation.step()
            self._break_due()
            self._tell_states()
            if time.monotonic() > end or (self._waiting and not self.simulation.busy):
                break

    def _break_due(self) -> None:
        """Inject the scheduled faults that are due."""
        for robot, fault in self._schedule.due():
            self._fault(robot, fault)

    def _tell_states(self) -> None:
        now = time.monotonic()
        for robot, session in self._controllers.items():
            if now - session.last_state_time < 1 / MOST_STATES or robot not in self.simulation.linked:
                continue
            due = session.rate > 0 and self.simulation.time >= session.next_state_time
            beat = now - session.last_state_time > HEARTBEAT
            if session.slow or not (due or beat):
                continue
            if not self._mute(robot):
                session.next_state_time = self.simulation.time + (1 / session.rate if session.rate else 0.0)
                state = self.simulation.state(robot)
                if not beat and session.reported_state is not None and is_same_state(state, session.reported_state):
                    continue
                session.reported_state = state
                session.send_line(State(state=state))
            elif beat:
                session.send_line(Unheard())
            else:
                continue
            session.last_state_time = now
        self._tell_poses(now)

    def _tell_poses(self, now: float, *, at_rest: bool = False) -> None:
        """Send poses to the subscribers whose next line is due; to all `at_rest`, because nothing may move again for long."""
        due = [
            (session, subscription)
            for session, subscription in self._followers.items()
            if (at_rest or now >= subscription.next_time) and not session.slow
        ]
        if not due:
            return
        if self._table is None or self._table.model is not self.simulation.scene.model:
            self._table = Table(self.simulation)
        row, statuses = self._table.row(), robot_statuses(self.simulation)
        for session, subscription in due:
            line = subscription.line(self._table, row, statuses, self.simulation.time, now)
            if line is not None:
                session.send_line(line)

    def _tell_waiting(self) -> None:
        for session, id in self._waiting:
            session.send_line(Answer(id=id, time=self.simulation.time))
        self._waiting.clear()

    # Connections

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        session = _Session(writer)
        self._sessions.add(session)
        try:
            self._welcome(session, await _next_line(reader))
            while True:
                self._hear(session, await _next_line(reader))
                if session.slow:
                    await writer.drain()
        except _Closing as closing:
            session.send_line(closing.line)
        except (asyncio.IncompleteReadError, ConnectionError):
            pass
        finally:
            self._close_session(session)
            writer.close()

    def _welcome(self, session: _Session, line: bytes) -> None:
        try:
            opening = read_opening(line)
            if (opening.protocol, opening.version) != (PROTOCOL, VERSION):
                client_protocol = f"{opening.protocol} {opening.version}"
                raise _Closing("version", f"this is {PROTOCOL} {VERSION}, not {client_protocol}; use a client of version {VERSION}")
            hello = read_by_server(line)
        except WireError as error:
            raise _Closing("hello-first", error.text) from None
        if not isinstance(hello, Hello):
            raise _Closing("hello-first", "the first line of a connection must be a hello")
        if hello.robot is not None:
            self._take_control(session, hello.robot)
        session.rate = hello.rate
        session.send_line(Welcome(robot=hello.robot, time=self.simulation.time))

    def _take_control(self, session: _Session, robot: str) -> None:
        """Give the connection control of the robot. Raises _Closing if that is impossible."""
        if robot not in self.simulation.linked:
            robot_names = ", ".join(sorted(self.simulation.linked)) or "none"
            raise _Closing("unknown-robot", f"there is no robot {robot}; the robots here are: {robot_names}")
        if Fault.LINK in self.simulation.linked[robot].faults:
            raise _Closing("link-cut", f"the link to {robot} is broken until it is repaired")
        if robot in self._controllers:
            raise _Closing("taken", f"{robot} is controlled by another connection; try again when that connection has ended")
        session.robot = robot
        self._controllers[robot] = session

    def _close_session(self, session: _Session) -> None:
        """Remove a connection. Its robot stops, and keeps what it holds."""
        self._sessions.discard(session)
        self._followers.pop(session, None)
        self._waiting = [(waiting_session, id) for waiting_session, id in self._waiting if waiting_session is not session]
        if session.robot is not None and self._controllers.get(session.robot) is session:
            del self._controllers[session.robot]
            if session.robot in self.simulation.linked:
                self.simulation.command(session.robot, Stop(), _ignore_result)

    def _hear(self, session: _Session, line: bytes) -> None:
        id: int | None = None
        try:
            message = read_by_server(line)
            match message:
                case Order(id=id):
                    self._command(session, message)
                case Ask(id=id, question=question):
                    self._ask(session, id, question)
                case Hello():
                    raise WireError("not-allowed", "hello was sent already; a connection is for one robot")
        except WireError as error:
            session.send_line(Refused(id=id, reason=error.code, description=error.text))
        except UsageError as error:
            session.send_line(Refused(id=id, reason="not-possible", description=str(error)))
        self._wake.set()

    def _command(self, session: _Session, order: Order) -> None:
        robot = session.robot
        if robot is None:
            raise WireError("not-allowed", "an operator's connection cannot command robots; connect as the robot's controller")

        def ended(result: CommandDone | CommandGivenUp) -> None:
            if self._mute(robot):
                return
            if isinstance(result, CommandDone):
                session.send_line(OrderDone(id=order.id, state=result.state, object_states=result.object_states))
            else:
                session.send_line(
                    OrderGivenUp(
                        id=order.id,
                        reason=result.reason,
                        description=result.description,
                        state=result.state,
                        object_states=result.object_states,
                    )
                )

        self.simulation.command(robot, order.command, ended)

    def _mute(self, robot: str) -> bool:
        """Whether a fault keeps the robot from sending anything."""
        return robot in self.simulation.linked and bool(self.simulation.linked[robot].faults & {Fault.SILENT, Fault.LINK})

    # Questions

    def _ask(self, session: _Session, id: int, question: Question) -> None:
        if session.robot is not None and not (isinstance(question, Ways) and question.robot == session.robot):
            raise WireError("not-allowed", f"the connection of a robot may send only `ways` of {session.robot}; connect as an operator")
        answer = Answer(id=id)
        match question:
            case Break(robot=robot, fault=fault, delay=None, carried=None, released=False):
                self._fault(robot, fault)
            case Break():
                self._schedule.add(question)
            case Repair(robot=robot, fault=fault):
                self._schedule.drop(robot, fault)
                self.simulation.repair(robot, fault)
            case Look(object=name):
                answer = Answer(id=id, object_state=self.simulation.observe(name))
            case Robots():
                answer = Answer(id=id, robots={name: self.simulation.state(name) for name in self.simulation.robots})
            case Clock():
                answer = Answer(id=id, time=self.simulation.time, speed=self.speed)
            case Picture(subject=subject):
                answer = Answer(id=id, png=self._picture(subject))
            case Ways(robot=robot, stops=stops):
                answer = Answer(id=id, lengths=leg_lengths(self.simulation, robot, stops))
            case Move(object=name, x=x, y=y, z=z, yaw=yaw):
                self.simulation.move(name, x, y, z, yaw)
            case Follow(rate=rate):
                self._followers.pop(session, None)
                if rate > 0:
                    self._followers[session] = PoseSubscription(min(rate, MOST_STATES))
            case Idle():
                self._waiting.append((session, id))
                return
        session.send_line(answer)

    def _picture(self, subject: str | None) -> bytes:
        scene = self.simulation.scene
        if subject is not None and subject not in scene.world.solids:
            raise UsageError(f"{subject} is not in the simulated world")
        try:
            self._camera = self._camera or Camera(scene)
            return self._camera.picture(close_up(scene, subject) if subject is not None else None)
        except SimulationError as error:
            raise WireError("no-graphics", str(error)) from None

    def _fault(self, robot: str, fault: Fault) -> None:
        self.simulation.fault(robot, fault)
        session = self._controllers.get(robot)
        if fault is Fault.LINK and session is not None:
            session.writer.transport.abort()
            self._close_session(session)


async def _next_line(reader: asyncio.StreamReader) -> bytes:
    try:
        return await reader.readuntil(b"\n")
    except asyncio.LimitOverrunError:
        raise _Closing("too-long", f"a line may have at most {LONGEST} bytes") from None


def _ignore_result(result: CommandDone | CommandGivenUp) -> None:
    """Discard the result of a command whose connection has ended."""

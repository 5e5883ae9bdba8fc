"""Hosts a simulation: advances its time, and serves the connections of robots and operators with the lines of `lines.py`.

One task steps the physics, in slices so short that the sockets are served in time. While nothing moves, it does not step the physics, and
the processor idles.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Iterator
from typing import TypeVar

from msgspec import Struct

from somrs.devices.link_security import ANY_ROLE, DEVICES, PEOPLE, Proof, start_listening
from somrs.devices.open_sockets import OpenSockets
from somrs.devices.simulator.link.commands import CommandDone, CommandGivenUp, Fault
from somrs.devices.simulator.link.lines import (
    HEARTBEAT,
    LONGEST,
    PROTOCOL,
    VERSION,
    Answer,
    Ask,
    Break,
    Clock,
    Devices,
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
    Roads,
    Robots,
    SetWeight,
    Traffic,
    Ways,
    Welcome,
    read_by_server,
    read_opening,
)
from somrs.devices.simulator.server.connections import Connection, ConnectionClosing, Connections
from somrs.devices.simulator.server.driving_distances import find_legs
from somrs.devices.simulator.server.faults import Schedule
from somrs.devices.simulator.server.link_names import LinkNames
from somrs.devices.simulator.server.pace import Pace
from somrs.devices.simulator.server.pictures import Pictures
from somrs.devices.simulator.server.simulation import Simulation
from somrs.errors import InputError, SimulationError, WireError
from somrs.ports import listen_at
from somrs.trust.credentials import Credentials

log = logging.getLogger(__name__)

S = TypeVar("S", bound=Struct)

TICK = 0.002
"""Shortest time in seconds for the sockets between two slices of physics; the event loop waits in milliseconds."""
SLICE = 0.004
"""Longest time in seconds for which a slice of physics may delay the sockets."""
MAX_LAG = 0.2
"""Largest lag in seconds of simulated time behind real time that is caught up; a larger lag is dropped."""
NAP = 0.05
"""Seconds between two checks of a world at rest, in real-time mode."""


_ROLES = {Break: PEOPLE, Repair: PEOPLE, Move: PEOPLE | DEVICES, SetWeight: PEOPLE | DEVICES}
"""The roles whose programs may change the world without a robot, where clients prove who they are. Programs of persons move what these have
moved."""


class Server:
    """Serves the simulation at a TCP port. `speed`: simulated seconds per second; None: as fast as the processor allows.

    `is_shared`: whether the world has several maps, so that its names are qualified. `credentials`: with them, clients have to prove who
    they are; a robot is controlled by who speaks for it, and `_ROLES` says who may change the world.
    """

    def __init__(
        self,
        simulation: Simulation,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        speed: float | None = None,
        is_shared: bool = False,
        credentials: Credentials | None = None,
    ) -> None:
        self._credentials = credentials
        self.simulation, self.host, self.port, self.speed = simulation, host, port, speed
        self._is_shared = is_shared
        self._schedule = Schedule(simulation)
        self._connections, self._sockets = Connections(simulation), OpenSockets()
        self._wake = asyncio.Event()
        self._pictures = Pictures(simulation)

    async def start(self) -> None:
        """Listen, start the simulated time, and set `port` to the actual port."""
        self._listener = await start_listening(
            self._serve, listen_at(self.host, self.port), LONGEST, self._credentials, is_shared=self._is_shared
        )
        self.port = self._listener.sockets[0].getsockname()[1]
        self._running = asyncio.create_task(self._run())

    async def ended(self) -> None:
        """Wait until the simulation ends. Raises SimulationError if it failed."""
        await asyncio.shield(self._running)

    async def stop(self) -> None:
        """End all connections. Raises the SimulationError that ended the simulation, if one did."""
        self._listener.close()
        self._running.cancel()
        for connection in self._connections:
            connection.writer.close()
        self._pictures.close()
        await asyncio.wait({self._running})
        if not self._running.cancelled():
            self._running.result()

    def wake(self) -> None:
        """Something may have to move: a simulation at rest goes on."""
        self._wake.set()

    # Time

    async def _run(self) -> None:
        try:
            await (self._run_fast() if self.speed is None else self._run_at(self.speed))
        except SimulationError as error:
            log.critical("%s", error)
            self._listener.close()
            for connection in self._connections:
                connection.send_line(Refused(reason="failed", description=str(error)))
                connection.writer.close()
            raise

    async def _run_fast(self) -> None:
        while True:
            if self.simulation.busy:
                self._step_for(SLICE)
                await asyncio.sleep(0)
                continue
            self._connections.tell_poses(time.monotonic(), at_rest=True)
            self._connections.tell_at_rest()
            self._connections.tell_states()
            await self._nap(HEARTBEAT / 2)

    async def _run_at(self, speed: float) -> None:
        start_time, origin, pace = time.monotonic(), self.simulation.time, Pace(speed)
        while True:
            lag = (time.monotonic() - start_time) * speed + origin - self.simulation.time
            if resting := lag > 0 and self.simulation.rest(self.simulation.time + lag):
                self._carry_out_due()
            elif lag > 0:
                if lag > MAX_LAG * speed:
                    start_time, origin = time.monotonic(), self.simulation.time
                self._step_for(SLICE, until_time=self.simulation.time + lag)
            self._warn_if_slow(pace)
            self._connections.tell_states()
            if self._connections.any_waits_for_rest and not self.simulation.busy:
                self._connections.tell_poses(time.monotonic(), at_rest=True)
                self._connections.tell_at_rest()
            if resting:
                await self._nap(NAP)
            else:
                await asyncio.sleep(max(TICK, (self.simulation.time - origin) / speed - (time.monotonic() - start_time)))

    def _warn_if_slow(self, pace: Pace) -> None:
        slow_speed = pace.measure(time.monotonic(), self.simulation.time)
        if slow_speed is not None:
            log.warning(
                "the simulation of %d robots runs at %.2f of real time, not at %g: this machine is too slow for it; "
                "a lower --speed can be met, and --world kinematic needs less time than physics",
                len(self.simulation.robots),
                slow_speed,
                pace.speed,
            )

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
            self._carry_out_due()
            self._connections.tell_states()
            if time.monotonic() > end or (self._connections.any_waits_for_rest and not self.simulation.busy):
                break

    def _carry_out_due(self) -> None:
        """Inject the scheduled faults and take the planned pictures that are due."""
        for robot, fault in self._schedule.due():
            self._fault(robot, fault)
        for connection, id, subject, width in self._pictures.due():
            with _refusing(connection, id):
                connection.send_line(Answer(id=id, png=self._pictures.take(subject, width)))

    # Connections

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        connection = Connection(writer, proof=Proof.of(self._credentials, writer))
        self._connections.add(connection)
        try:
            if not self._sockets.add(writer):
                raise ConnectionClosing("full", f"this simulator serves {self._sockets.limit} connections, which is the limit")
            self._welcome(connection, await _next_line(reader))
            self._sockets.note_heard(writer)
            while True:
                self._hear(connection, await _next_line(reader))
                if connection.slow:
                    await writer.drain()
        except ConnectionClosing as closing:
            connection.send_line(closing.line)
        except (asyncio.IncompleteReadError, ConnectionError):
            pass
        finally:
            self._connections.remove(connection)
            self._sockets.remove(writer)
            writer.close()

    def _welcome(self, connection: Connection, line: bytes) -> None:
        try:
            opening = read_opening(line)
            if (opening.protocol, opening.version) != (PROTOCOL, VERSION):
                client_protocol = f"{opening.protocol} {opening.version}"
                raise ConnectionClosing(
                    "version", f"this is {PROTOCOL} {VERSION}, not {client_protocol}; use a client of version {VERSION}"
                )
            hello = read_by_server(line)
        except WireError as error:
            raise ConnectionClosing("hello-first", error.text) from None
        if not isinstance(hello, Hello):
            raise ConnectionClosing("hello-first", "the first line of a connection must be a hello")
        if self._is_shared and hello.map is not None:
            connection.names = LinkNames(hello.map)
        hello = self._in_names_of_world(connection, hello)
        try:
            if hello.robot is None:
                connection.proof.check(looks_only=self._is_shared)
            else:
                connection.proof.check(DEVICES, hello.robot)
        except WireError as error:
            raise ConnectionClosing(error.code, error.text) from None
        if hello.robot is not None:
            self._connections.take_control(connection, hello.robot, is_outside=hello.outside)
        connection.rate = hello.rate
        connection.send_line(Welcome(robot=hello.robot, time=self.simulation.time))

    def _hear(self, connection: Connection, line: bytes) -> None:
        with _refusing(connection):
            message = read_by_server(line)
            with _refusing(connection, None if isinstance(message, Hello) else message.id):
                match message:
                    case Order():
                        self._command(connection, message)
                    case Ask(id=id, question=question):
                        self._ask(connection, id, question)
                    case Hello():
                        raise WireError("not-allowed", "hello was sent already; a connection is for one robot")
        self.wake()

    def _in_names_of_world(self, connection: Connection, message: S) -> S:
        """What a client says, in the names of the world."""
        names = connection.names
        return names.from_client(message, self.simulation.scene.world.ontology) if names is not None else message

    def _command(self, connection: Connection, order: Order) -> None:
        robot = connection.robot
        if robot is None:
            raise WireError("not-allowed", "an operator's connection cannot command robots; connect as the robot's controller")
        connection.proof.check(DEVICES, robot)

        def ended(result: CommandDone | CommandGivenUp) -> None:
            if self._connections.is_mute(robot):
                return
            if isinstance(result, CommandDone):
                connection.send_line(
                    OrderDone(
                        id=order.id,
                        state=result.state,
                        object_states=result.object_states,
                        sightings=result.sightings,
                        clear=result.clear,
                        ranges=result.ranges,
                    )
                )
            else:
                connection.send_line(
                    OrderGivenUp(
                        id=order.id,
                        reason=result.reason,
                        description=result.description,
                        state=result.state,
                        object_states=result.object_states,
                        sightings=result.sightings,
                    )
                )

        self.simulation.command(robot, self._in_names_of_world(connection, order.command), ended)

    # Questions

    def _ask(self, connection: Connection, id: int, question: Question) -> None:
        connection.proof.check(_ROLES.get(type(question), ANY_ROLE), looks_only=self._is_shared and type(question) not in _ROLES)
        question = self._in_names_of_world(connection, question)
        if connection.robot is not None and not (isinstance(question, Ways) and question.robot == connection.robot):
            raise WireError("not-allowed", f"the connection of a robot may send only `ways` of {connection.robot}; connect as an operator")
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
            case Devices():
                answer = Answer(id=id, devices=self.simulation.devices())
            case Roads():
                answer = Answer(id=id, roadmap=self.simulation.roadmap())
            case Traffic():
                answer = Answer(id=id, traffic=self.simulation.traffic())
            case Clock():
                answer = Answer(id=id, time=self.simulation.time, speed=self.speed)
            case Picture(subject=subject, width=width, robot=None, carried=None):
                answer = Answer(id=id, png=self._pictures.take(subject, width))
            case Picture():
                self._pictures.plan(connection, id, question)
                return
            case Ways(robot=robot, stops=stops, situation=situation):
                legs = find_legs(self.simulation, robot, stops, situation)
                answer = Answer(
                    id=id,
                    lengths=legs.lengths,
                    shut=legs.shut,
                    open=legs.open,
                    carries=legs.carries,
                    out_of_order=legs.out_of_order or None,
                    zones=legs.zones or None,
                    out_of_reach=legs.out_of_reach or None,
                )
            case SetWeight(object=name, weight=weight):
                self.simulation.set_weight(name, weight)
            case Move(object=name, x=x, y=y, z=z, yaw=yaw):
                self.simulation.move(name, x, y, z, yaw)
            case Follow(rate=rate):
                self._connections.follow(connection, rate)
            case Idle():
                self._connections.notify_at_rest(connection, id)
                return
        connection.send_line(answer)

    def _fault(self, robot: str, fault: Fault) -> None:
        self.simulation.fault(robot, fault)
        if fault is Fault.LINK:
            self._connections.cut_link(robot)


@contextlib.contextmanager
def _refusing(connection: Connection, id: int | None = None) -> Iterator[None]:
    """Send the error of a request as a refusal of the order or question with this id; None: of no particular one."""
    try:
        yield
    except WireError as error:
        connection.send_line(Refused(id=id, reason=error.code, description=error.text))
    except InputError as error:
        connection.send_line(Refused(id=id, reason="not-possible", description=str(error)))


async def _next_line(reader: asyncio.StreamReader) -> bytes:
    try:
        return await reader.readuntil(b"\n")
    except asyncio.LimitOverrunError:
        raise ConnectionClosing("too-long", f"a line may have at most {LONGEST} bytes") from None

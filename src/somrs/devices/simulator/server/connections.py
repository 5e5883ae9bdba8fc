"""The connections of robots and operators: which robot each controls, and the states and poses that it receives."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from dataclasses import dataclass

from somrs.devices.link_security import OPEN, Proof
from somrs.devices.simulator.link.commands import CommandDone, CommandGivenUp, Fault, RobotState, Stop
from somrs.devices.simulator.link.lines import HEARTBEAT, Answer, Refused, ServerLine, State, Unheard, encode_line
from somrs.devices.simulator.server.link_names import LinkNames
from somrs.devices.simulator.server.poses import PoseSubscription, Table, is_same_state, robot_statuses
from somrs.devices.simulator.server.simulation import Simulation

MOST_STATES = 50.0
"""Largest number of state lines per second for a connection."""
SLOW_READER, TOO_SLOW_READER = 256 * 1024, 16 * 1024 * 1024
"""Bytes not yet read by a client, above which it receives no states, and above which its connection is aborted."""


@dataclass(slots=True, eq=False)
class Connection:
    """One connection. `robot`: the robot that it controls; None for an operator. `names`: those of its map, if they are not the world's."""

    writer: asyncio.StreamWriter
    robot: str | None = None
    rate: float = 0.0
    next_state_time: float = 0.0
    """In simulated time, s."""
    last_state_time: float = 0.0
    """In real time, by the monotonic clock, s."""
    reported_state: RobotState | None = None
    """The state that was sent last."""
    names: LinkNames | None = None
    proof: Proof = OPEN

    def send_line(self, line: ServerLine) -> None:
        if self.writer.transport.get_write_buffer_size() > TOO_SLOW_READER:
            self.writer.transport.abort()
        elif not self.writer.transport.is_closing():
            encoded = encode_line(line)
            self.writer.write(self.names.to_client(encoded) if self.names is not None else encoded)

    @property
    def slow(self) -> bool:
        return self.writer.transport.get_write_buffer_size() > SLOW_READER


class ConnectionClosing(Exception):
    """Ends the connection after sending `line`."""

    def __init__(self, reason: str, description: str) -> None:
        self.line = Refused(reason=reason, description=description)
        super().__init__(reason)


class Connections:
    """The connections that are open."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._all: set[Connection] = set()
        self._controllers: dict[str, Connection] = {}
        self._waiting: list[tuple[Connection, int]] = []
        self.followers: dict[Connection, PoseSubscription] = {}
        self._table: Table | None = None

    def __iter__(self) -> Iterator[Connection]:
        return iter([*self._all])

    def add(self, connection: Connection) -> None:
        self._all.add(connection)

    def remove(self, connection: Connection) -> None:
        """Remove a connection. Its robot stops, and keeps what it holds."""
        self._all.discard(connection)
        self.followers.pop(connection, None)
        self._waiting = [(waiting_connection, id) for waiting_connection, id in self._waiting if waiting_connection is not connection]
        if connection.robot is not None and self._controllers.get(connection.robot) is connection:
            del self._controllers[connection.robot]
            if connection.robot in self._simulation.linked:
                self._simulation.command(connection.robot, Stop(), _ignore_result)

    def take_control(self, connection: Connection, robot: str, *, is_outside: bool = False) -> None:
        """Give the connection control of the robot, which takes part in traffic from outside or not. Raises ConnectionClosing if
        that is impossible."""
        if robot not in self._simulation.linked:
            robot_names = ", ".join(sorted(self._simulation.linked)) or "none"
            raise ConnectionClosing("unknown-robot", f"there is no robot {robot}; the robots here are: {robot_names}")
        if Fault.LINK in self._simulation.linked[robot].faults:
            raise ConnectionClosing("link-cut", f"the link to {robot} is broken until it is repaired")
        if robot in self._controllers:
            raise ConnectionClosing("taken", f"{robot} is controlled by another connection; try again when that connection has ended")
        connection.robot = robot
        self._controllers[robot] = connection
        self._simulation.set_outside(robot, is_outside)

    def is_mute(self, robot: str) -> bool:
        """Whether a fault keeps the robot from sending anything."""
        return robot in self._simulation.linked and self._simulation.linked[robot].is_mute

    @property
    def any_waits_for_rest(self) -> bool:
        """Whether a connection waits until nothing moves."""
        return bool(self._waiting)

    def notify_at_rest(self, connection: Connection, id: int) -> None:
        """Answer the question of this number as soon as nothing moves."""
        self._waiting.append((connection, id))

    def follow(self, connection: Connection, rate: float) -> None:
        """Send poses to the connection at this rate in lines per second; 0: send none."""
        self.followers.pop(connection, None)
        if rate > 0:
            self.followers[connection] = PoseSubscription(min(rate, MOST_STATES))

    def cut_link(self, robot: str) -> None:
        """Abort the connection that controls the robot."""
        connection = self._controllers.get(robot)
        if connection is not None:
            connection.writer.transport.abort()
            self.remove(connection)

    def tell_states(self) -> None:
        """Send states to the controllers of robots, and poses to the subscribers, whose next line is due."""
        now = time.monotonic()
        for robot, connection in self._controllers.items():
            if now - connection.last_state_time < 1 / MOST_STATES or robot not in self._simulation.linked:
                continue
            due = connection.rate > 0 and self._simulation.time >= connection.next_state_time
            beat = now - connection.last_state_time > HEARTBEAT
            if connection.slow or not (due or beat):
                continue
            if not self.is_mute(robot):
                connection.next_state_time = self._simulation.time + (1 / connection.rate if connection.rate else 0.0)
                state = self._simulation.state(robot)
                if not beat and connection.reported_state is not None and is_same_state(state, connection.reported_state):
                    continue
                connection.reported_state = state
                connection.send_line(State(state=state))
            elif beat:
                connection.send_line(Unheard())
            else:
                continue
            connection.last_state_time = now
        self.tell_poses(now)

    def tell_poses(self, now: float, *, at_rest: bool = False) -> None:
        """Send poses to the subscribers whose next line is due; to all `at_rest`, because nothing may move again for long."""
        due = [
            (connection, subscription)
            for connection, subscription in self.followers.items()
            if (at_rest or now >= subscription.next_time) and not connection.slow
        ]
        if not due:
            return
        if self._table is None or self._table.edition != self._simulation.scene.edition:
            self._table = Table(self._simulation)
        row, statuses = self._table.row(), robot_statuses(self._simulation)
        for connection, subscription in due:
            line = subscription.line(self._table, row, statuses, self._simulation.time, now)
            if line is not None:
                connection.send_line(line)

    def tell_at_rest(self) -> None:
        """Answer the connections that wait until nothing moves."""
        for connection, id in self._waiting:
            connection.send_line(Answer(id=id, time=self._simulation.time))
        self._waiting.clear()


def _ignore_result(result: CommandDone | CommandGivenUp) -> None:
    """Discard the result of a command whose connection has ended."""

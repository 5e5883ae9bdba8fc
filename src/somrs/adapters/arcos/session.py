"""The session with a robot: synchronization, what is asked of it at the beginning, and whether it still reports.

The robot stops by itself when it has heard nothing for two seconds (its watchdog). The session says something only in answer to reports, so
that a robot that cannot be observed is not kept driving either.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum, auto

from somrs.adapters.arcos.line_quality import LineQuality
from somrs.adapters.arcos.messages import (
    Command,
    Configuration,
    Flag,
    GripperReport,
    Status,
    SyncReply,
    command,
    report,
    sync,
    sync_reply,
)
from somrs.adapters.arcos.motors import Motors
from somrs.adapters.arcos.packets import PacketParser, packet_length

LISTENING_TIME = 0.35
"""Seconds to wait for a report of a session that goes on, before a new one is begun."""
REPEAT = 0.5
"""Seconds after which what has had no effect is said again."""
TRIES = 4
"""How often, before the synchronization begins anew."""
STOP_AFTER, SILENT_AFTER = 0.3, 3.0
"""Seconds without a report after which the robot is told to stop, and after which it counts as silent."""
MISTRUST_TIME = 4.0
"""Seconds in which a robot that hears nothing stands: the usual time of its watchdog, and the time in which it brakes."""
SAMPLE = 24
"""How many of the bytes that came are kept for people."""
LONGEST_PACKET = 0.25
"""Seconds from which on a packet that is not complete is noise. What came after it is too old to be taken for news."""
LONGEST_STEP = 0.25
"""What a step of time counts at most, s: while this program is suspended, nobody is silent."""


class SessionState(StrEnum):
    """The states of a session, in their order."""

    DISCONNECTED = auto()
    """There is no line to the robot."""
    LISTENING = auto()
    """There is a line. A session of before may go on."""
    SYNC0 = auto()
    SYNC1 = auto()
    SYNC2 = auto()
    OPENING = auto()
    """The robot was told to report."""
    OPEN = auto()
    """The robot reports."""
    MISTRUSTED = auto()
    """The robot reports, and does not do what it is told. Nothing is said to it, so that its own watchdog stops it."""


_FOLLOWING_STATES = {
    SessionState.SYNC0: SessionState.SYNC1,
    SessionState.SYNC1: SessionState.SYNC2,
    SessionState.SYNC2: SessionState.OPENING,
}
_REPORTING = {SessionState.LISTENING, SessionState.OPENING, SessionState.OPEN, SessionState.MISTRUSTED}
"""A report during the synchronization is of the session that is to end."""
_SYNC_NUMBER = {SessionState.SYNC0: 0, SessionState.SYNC1: 1, SessionState.SYNC2: 2}


class Session:
    """A session with a robot. `receive` and `tick` add what is to be sent to `outgoing`. `motors`: who may switch them on."""

    def __init__(self, motors: Motors) -> None:
        self.motors = motors
        self.state = SessionState.DISCONNECTED
        self.identity: tuple[str, ...] = ()
        """The robot's name, class and subclass, as far as it has said them."""
        self.configuration: Configuration | None = None
        self.gripper: GripperReport | None = None
        self.has_gone_on = False
        """Whether the session is that of an earlier line."""
        self.outgoing = bytearray()
        self.problem: str | None = None
        """Why the robot cannot be reached, for people, as far as it is known."""
        self.sample = b""
        """The beginning of what has come since there was a line, or a session."""
        self.quality = LineQuality()
        self._packets = 0
        """How many packets have come meanwhile."""
        self._parser, self._complete_time = PacketParser(), 0.0
        self._time = 0.0
        self._waited = 0.0
        self._repeated = 0.0
        self._tries = 0
        self._send_time = 0.0
        self._gripper_requests = 0

    @property
    def is_open(self) -> bool:
        return self.state is SessionState.OPEN

    @property
    def is_known(self) -> bool:
        """Whether the robot has said what it has, or leaves the question unanswered."""
        return self.is_open and (self.gripper is not None or self._gripper_requests >= TRIES)

    def connect(self, now: float) -> None:
        """There is a line to the robot."""
        self._parser, self._complete_time = PacketParser(), now
        self._time = now
        self.outgoing.clear()
        self.sample, self._packets = b"", 0
        self._enter(SessionState.LISTENING)

    def disconnect(self, problem: str | None) -> None:
        """There is no line to the robot. `problem`: why, for people; None: as it was."""
        self.outgoing.clear()
        self.problem = problem or self.problem
        self._enter(SessionState.DISCONNECTED)

    def mistrust(self, problem: str) -> None:
        """The robot does not do what it is told. It is told to stop once more, and a new session is begun when it stands."""
        self.send(Command.ESTOP)
        self.problem = problem
        self._enter(SessionState.MISTRUSTED)

    def close(self) -> None:
        """Stop the robot, and end the session."""
        if self.state is not SessionState.DISCONNECTED:
            self.send(Command.STOP)
            self.send(Command.CLOSE)
            self._enter(SessionState.LISTENING)

    def send(self, number: Command, argument: int | None = None) -> None:
        if self.state is SessionState.MISTRUSTED:
            return
        if number is Command.CHARGE:
            self.motors.charge(bool(argument))
        self.outgoing += command(number, argument)
        self._send_time = self._time

    def receive(self, data: bytes, now: float) -> list[Status]:
        """Take in bytes, and return the reports on the robot that they complete."""
        self.tick(now)
        if now - self._complete_time > LONGEST_PACKET:
            self._parser = PacketParser()
        reports = []
        bodies = self._parser.feed(data)
        self._note(data, bodies, now)
        if bodies or not self._parser.is_waiting:
            self._complete_time = now
        for body in bodies:
            if (reply := sync_reply(body)) is not None:
                self._hear_reply(reply)
                continue
            match report(body):
                case Status() as status if self.state in _REPORTING:
                    if self.state is not SessionState.MISTRUSTED:
                        self._hear_status(status)
                    reports.append(status)
                case GripperReport() as gripper:
                    self.gripper = gripper
                case Configuration() as configuration:
                    self.configuration = configuration
        return reports

    def _note(self, data: bytes, bodies: Sequence[bytes], now: float) -> None:
        """Note what has come, so that people can be told."""
        self.sample = (self.sample + data)[:SAMPLE]
        self._packets += len(bodies)
        if self.state is SessionState.OPEN:
            self.quality.count(len(data), sum(map(packet_length, bodies)), now)

    def tick(self, now: float) -> None:
        """Time has passed."""
        step = min(max(0.0, now - self._time), LONGEST_STEP)
        self._time = now
        self._waited += step
        self._repeated += step
        match self.state:
            case SessionState.LISTENING if self._waited >= LISTENING_TIME:
                self._begin()
            case SessionState.SYNC0 | SessionState.SYNC1 | SessionState.SYNC2 | SessionState.OPENING if self._repeated >= REPEAT:
                self._tries += 1
                if self._tries < TRIES:
                    self._say_state()
                else:
                    self.problem = self._why_unanswered()
                    self._begin()
            case SessionState.MISTRUSTED if self._waited >= MISTRUST_TIME:
                self._begin()
            case SessionState.OPEN if self._waited >= SILENT_AFTER:
                self._enter(SessionState.LISTENING)
            case SessionState.OPEN if self._waited >= STOP_AFTER and now - self._send_time >= STOP_AFTER:
                self.send(Command.STOP)

    def _why_unanswered(self) -> str:
        """Why no session has begun, for people."""
        if self.state is SessionState.OPENING:
            return "it opens a session, and reports nothing then"
        if not self.sample:
            return "it does not answer: nothing comes. Is it switched on, and is it at this port?"
        if not self._packets:
            return "what comes from it are no packets of ARCOS. Does its line have this baud rate?"
        return "it sends packets, and does not begin a session. Is another program connected to it?"

    def _begin(self) -> None:
        """Begin a session anew."""
        self.motors.begin_session()
        self._gripper_requests = 0
        self._enter(SessionState.SYNC0)
        self._say_state()

    def _enter(self, state: SessionState) -> None:
        self.state, self._waited, self._repeated, self._tries = state, 0.0, 0.0, 0

    def _say_state(self) -> None:
        """Send what the state waits to be answered."""
        self._repeated = 0.0
        if self.state is SessionState.OPENING:
            self.send(Command.OPEN)
            return
        if self.state is SessionState.SYNC0:
            # A robot that is in a session takes this packet for PULSE, and goes on with the velocities that it has. It hears
            # first, and twice, that it is to stop, and that the session is over.
            for number in (Command.ESTOP, Command.CLOSE) * 2:
                self.send(number)
        self.outgoing += sync(_SYNC_NUMBER[self.state])

    def _hear_reply(self, reply: SyncReply) -> None:
        if _SYNC_NUMBER.get(self.state) != reply.number:
            return
        if reply.number == 2:
            self.identity = reply.identity
        self._enter(_FOLLOWING_STATES[self.state])
        self._say_state()

    def _hear_status(self, status: Status) -> None:
        self.motors.update(status)
        if self.state is SessionState.OPEN:
            self._waited = 0.0
        else:
            # It may drive with the velocities of a program that is gone.
            self.has_gone_on, self.problem = self.state is SessionState.LISTENING, None
            self._enter(SessionState.OPEN)
            self.send(Command.STOP)
            self.send(Command.BUMPSTALL, 3)
            self._request_missing(status)
        if self.motors.are_to_go_off:
            self.send(Command.ENABLE, 0)
        if self._repeated >= REPEAT:
            self._repeated = 0.0
            self._request_missing(status)
        if self._time - self._send_time >= 2 * REPEAT:
            self.send(Command.PULSE)

    def _request_missing(self, status: Status) -> None:
        """Ask again for what was asked at the beginning, and has not come."""
        if self.motors.are_to_go_on and not status.flags & Flag.MOTORS:
            self.send(Command.ENABLE, 1)
        if not status.flags & 0b11110:
            self.send(Command.SONAR, 1)
        if self.configuration is None:
            self.send(Command.CONFIG)
        if self.gripper is None and self._gripper_requests < TRIES:
            self._gripper_requests += 1
            self.send(Command.GRIPREQUEST, 1)

"""The lines of the robot link, version 1: JSON objects, one a line, told apart by `say`. Described for people in
`docs/reference/robot-protocol.md`; who may say what when is `server.py`'s business.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta, Struct, field

from somrs.devices.simulator.link.commands import Command, Fault, ObjectState, RobotState
from somrs.errors import WireError

PROTOCOL = "SO-MRS robot link"
VERSION = 1
HEARTBEAT = 1.0
"""Seconds after which the simulator says something of each robot, though nothing changed."""
LONGEST = 64 * 1024
"""Bytes of the longest line that a server reads."""

Stops = tuple[str | tuple[float, float], ...]
"""Objects and points that a way leads to, one after the other."""


class Hello(Struct, frozen=True, kw_only=True, tag="hello", tag_field="say"):
    """The first line of a client: for which robot (or camera) it speaks, or None for an operator."""

    protocol: str = PROTOCOL
    version: int
    robot: str | None = None
    rate: Annotated[float, Meta(ge=0)] = 10.0
    """How often it wants to hear the robot's state while that changes, per second of simulated time; 0: only about once a second."""


class Opening(Struct, frozen=True, kw_only=True):
    """What the first line of any client of any version has: enough to say that one speaks another version."""

    protocol: str = PROTOCOL
    version: int


class Order(Struct, frozen=True, kw_only=True, tag="command", tag_field="say"):
    """A command for the connection's robot. The id is the client's choice, and comes back with the answer."""

    id: int
    command: Command


class Break(Struct, frozen=True, kw_only=True, tag="break", tag_field="ask"):
    """Let something fail: now; `delay` so many simulated seconds; when the robot has `carried` something so many metres; or when
    it has `released` what it carried, and has drawn its arm in.
    """

    robot: str
    fault: Fault
    delay: Annotated[float, Meta(ge=0)] | None = field(default=None, name="after")
    carried: Annotated[float, Meta(ge=0)] | None = None
    released: bool = False


class Repair(Struct, frozen=True, kw_only=True, tag="repair", tag_field="ask"):
    """Mend it; what was scheduled and has not happened yet is called off."""

    robot: str
    fault: Fault


class Look(Struct, frozen=True, kw_only=True, tag="look", tag_field="ask"):
    """Where an object is in the physics, whatever robots know of it."""

    object: str


class Robots(Struct, frozen=True, kw_only=True, tag="robots", tag_field="ask"):
    """The states of all robots."""


class Clock(Struct, frozen=True, kw_only=True, tag="clock", tag_field="ask"):
    """The simulated time."""


class Picture(Struct, frozen=True, kw_only=True, tag="picture", tag_field="ask"):
    """A picture of the world, or of what is around an object, as PNG."""

    subject: str | None = None


class Ways(Struct, frozen=True, kw_only=True, tag="ways", tag_field="ask"):
    """How far the robot would have to drive to come within reach of the first of these, from there to the next, and so on."""

    robot: str
    stops: Stops = field(name="through")


class Idle(Struct, frozen=True, kw_only=True, tag="idle", tag_field="ask"):
    """Answered when no robot does anything any more."""


class Move(Struct, frozen=True, kw_only=True, tag="move", tag_field="ask"):
    """Put an object elsewhere, by magic."""

    object: str
    x: float
    y: float
    z: float
    yaw: float = 0.0


class Follow(Struct, frozen=True, kw_only=True, tag="poses", tag_field="ask"):
    """From now on, where everything is that can move: `rate` lines a second on the clock on the wall at most; 0: no more."""

    rate: Annotated[float, Meta(ge=0)] = 20.0


Question = Break | Repair | Look | Robots | Clock | Picture | Ways | Idle | Move | Follow


class Ask(Struct, frozen=True, kw_only=True, tag="ask", tag_field="say"):
    """An operator's question or intervention. A robot's connection may ask for `ways` of its robot."""

    id: int
    question: Question


ClientLine = Hello | Order | Ask


class Welcome(Struct, frozen=True, kw_only=True, tag="welcome", tag_field="say"):
    """The answer to a hello that is accepted."""

    protocol: str = PROTOCOL
    version: int = VERSION
    robot: str | None = None
    time: float


class State(Struct, frozen=True, kw_only=True, tag="state", tag_field="say"):
    """The robot's state, unasked."""

    state: RobotState


class Unheard(Struct, frozen=True, kw_only=True, tag="unheard", tag_field="say"):
    """The simulator goes on, and the robot says nothing: once for each `HEARTBEAT` without a word of it."""


class Mover(Struct, frozen=True, kw_only=True):
    """Something that can move, and how many `numbers` say how it is.

    4, a robot: x, y, z, yaw. 6, a thing: x, y, z, yaw, pitch, roll. 9, a robot with an arm: x, y, z, yaw; the angle of its turret; how
    high its boom is above its floor, and how far its hand is out; the angle of its hand; how far each finger is from the middle.
    """

    name: str
    numbers: int


class RobotStatus(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What a robot or a camera holds, does, and cannot do."""

    holding: str | None = None
    activity: str | None = field(default=None, name="doing")
    faults: tuple[Fault, ...] = ()


class Poses(Struct, frozen=True, kw_only=True, omit_defaults=True, tag="poses", tag_field="say"):
    """What moved since the last one, to an operator who follows. Comes about once a second though nothing moved."""

    time: float
    """Simulated."""
    clock: float
    """Seconds on the simulator's clock on the wall, which began at any time."""
    movers: tuple[Mover, ...] | None = None
    """All that can move, in the first line, and when the set is another one. Then everything is said anew."""
    moved: tuple[int, ...] = ()
    """Those of them that moved, counted from 0."""
    values: tuple[float, ...] = ()
    """The numbers of those, one after the other."""
    robots: dict[str, RobotStatus] = {}
    """Of whom this is otherwise than before."""


class OrderDone(Struct, frozen=True, kw_only=True, tag="done", tag_field="say"):
    """The command with this id was carried out."""

    id: int
    state: RobotState
    object_states: tuple[ObjectState, ...] = field(default=(), name="seen")


class OrderGivenUp(Struct, frozen=True, kw_only=True, tag="gave", tag_field="say"):
    """The command with this id was given up; the reasons are those of `CommandGivenUp`."""

    id: int
    reason: str
    description: str
    state: RobotState
    object_states: tuple[ObjectState, ...] = field(default=(), name="seen")


class Answer(Struct, frozen=True, kw_only=True, tag="answer", tag_field="say"):
    """The answer to a question. Of its parts only those are there that the question asks for."""

    id: int
    object_state: ObjectState | None = field(default=None, name="seen")
    robots: dict[str, RobotState] | None = None
    time: float | None = None
    speed: float | None = None
    """Simulated seconds per second; None: as many as the processor can do."""
    png: bytes | None = None
    """In JSON: base64."""
    lengths: tuple[float | None, ...] | None = None
    """Metres of each leg of the way; None from the first leg on for which there is no way."""


class Refused(Struct, frozen=True, kw_only=True, tag="error", tag_field="say"):
    """Something cannot be processed. `reason` is a word for programs:

    `too-long`, `hello-first`, `version`, `unknown-robot`, `taken`, `link-cut`, `failed` (the simulation), after each of which
    the connection is closed; `malformed`, `not-allowed`, `not-possible`, `no-graphics`, after which it goes on.
    """

    reason: str
    description: str
    id: int | None = None


ServerLine = Welcome | State | Unheard | Poses | OrderDone | OrderGivenUp | Answer | Refused

_opening = msgspec.json.Decoder(Opening)
_to_server: msgspec.json.Decoder[ClientLine] = msgspec.json.Decoder(ClientLine)
_to_client: msgspec.json.Decoder[ServerLine] = msgspec.json.Decoder(ServerLine)


def encode_line(line: ClientLine | ServerLine) -> bytes:
    """The line with its newline."""
    return msgspec.json.encode(line) + b"\n"


def read_opening(line: bytes) -> Opening:
    """What protocol the first line of a client is of. Raises WireError."""
    try:
        return _opening.decode(line)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise WireError("hello-first", f"the first line has to be a hello with a version: {error}") from None


def read_by_server(line: bytes) -> ClientLine:
    """What a client said. Raises WireError."""
    try:
        return _to_server.decode(line)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise WireError("malformed", f"not a line of {PROTOCOL} {VERSION}: {error}") from None


def read_by_client(line: bytes) -> ServerLine:
    """What a server said. Raises WireError."""
    try:
        return _to_client.decode(line)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise WireError("malformed", f"not a line of {PROTOCOL} {VERSION}: {error}") from None

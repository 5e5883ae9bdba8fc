"""The lines of the robot link, version 1: JSON objects, one per line, distinguished by `say`.

`docs/reference/robot-protocol.md` describes the protocol; `server.py` implements its rules.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta, Struct, field

from somrs.devices.simulator.link.commands import Command, Fault, LinkedDevice, ObjectState, RobotState, Sighting
from somrs.devices.simulator.link.roads import Roadmap, TrafficState
from somrs.errors import WireError

PROTOCOL = "SO-MRS robot link"
VERSION = 1
HEARTBEAT = 1.0
"""Longest time in seconds between two lines about a robot, even if nothing changed."""
LONGEST = 64 * 1024
"""Longest line that a server reads, in bytes."""


class StandAt(Struct, frozen=True):
    """A point at which the robot is to stand, and which is not only to be in its reach. `z`: the height of its floor; None: the robot's."""

    x: float
    y: float
    z: float | None = None


PathStop = str | Annotated[tuple[float, ...], Meta(min_length=2, max_length=3)] | StandAt
"""An object, the handles of one (`HANDLES` after its name), a point to reach: x, y and, if it matters on which floor it is, z; or a point
to stand at."""
HANDLES = "/handles"
"""Where a robot opens and closes a door, or the doors of furniture."""
Stops = tuple[PathStop, ...]
"""Objects and points that a path visits in this order."""


class Hello(Struct, frozen=True, kw_only=True, tag="hello", tag_field="say"):
    """The first line of a client. `robot`: the robot or camera that it controls; None for an operator.

    `map`: the map in whose names the client speaks, in a world with several; None: in qualified names, such as `Barn:Jar1`. `outside`: the
    robot takes part in traffic by messages of a program of its own, and not in the simulator; it stays so when the connection ends.
    """

    protocol: str = PROTOCOL
    version: int
    robot: str | None = None
    outside: bool = False
    rate: Annotated[float, Meta(ge=0)] = 10.0
    """State lines per second of simulated time while the state changes; 0: only about one per second."""
    map: str | None = None


class Opening(Struct, frozen=True, kw_only=True):
    """The fields that the first line of a client has in every version, to detect clients of other versions."""

    protocol: str = PROTOCOL
    version: int


class Order(Struct, frozen=True, kw_only=True, tag="command", tag_field="say"):
    """A command for the connection's robot. The client chooses the id; the answer repeats it."""

    id: int
    command: Command


class Break(Struct, frozen=True, kw_only=True, tag="break", tag_field="ask"):
    """Inject a fault: now; after `delay` simulated seconds; when the robot has `carried` something for so many metres, or a lift a robot;
    or when it has `released` what it carried and has drawn its arm in.
    """

    robot: str
    fault: Fault
    delay: Annotated[float, Meta(ge=0)] | None = field(default=None, name="after")
    carried: Annotated[float, Meta(ge=0)] | None = None
    released: bool = False


class Repair(Struct, frozen=True, kw_only=True, tag="repair", tag_field="ask"):
    """Repair a fault, and cancel scheduled faults of this kind."""

    robot: str
    fault: Fault


class Look(Struct, frozen=True, kw_only=True, tag="look", tag_field="ask"):
    """Request the true pose of an object."""

    object: str


class Robots(Struct, frozen=True, kw_only=True, tag="robots", tag_field="ask"):
    """Request the states of all robots."""


class Devices(Struct, frozen=True, kw_only=True, tag="devices", tag_field="ask"):
    """Request the states of all robots, cameras, scales, lifts and doors with a drive, and the faults that they can have."""


class Clock(Struct, frozen=True, kw_only=True, tag="clock", tag_field="ask"):
    """Request the simulated time and the speed."""


class Picture(Struct, frozen=True, kw_only=True, tag="picture", tag_field="ask"):
    """Request a picture of the world, of a storey, or of an object and its surroundings, as PNG.

    `width`: in pixels; the height is 3/4 of it. With `robot` and `carried`, the answer comes as soon as the robot has carried an object for
    so many metres, or a lift a robot; 0: as soon as it holds one.
    """

    subject: str | None = None
    width: Annotated[int, Meta(ge=40, le=1200)] = 1200
    robot: str | None = None
    carried: Annotated[float, Meta(ge=0)] | None = None


class Ways(Struct, frozen=True, kw_only=True, tag="ways", tag_field="ask"):
    """Request the driving distances to within reach of the first stop, from there to the next, and so on.

    `situation`: what other devices will have changed when the robot starts, in Entish: doors that are open or shut then, and where things
    and robots are.
    """

    robot: str
    stops: Stops = field(name="through")
    situation: str | None = None


class Legs(Struct, frozen=True):
    """The way through several stops: the driving distance of each leg in metres, None where there is no path.

    `shut`: the shut doors that have to be opened for it; `open`: the open doors that have to stay open. `carries`: whether robots can put
    things on the last stop; True for a point. `out_of_order`: if there is no path, the doors and lifts without which there is none, because
    they are out of order; `zones`: the no-go zones without which there would be one; `out_of_reach`: whether there is no point at all from
    which the robot would reach the first stop without a path.
    """

    lengths: tuple[float | None, ...]
    shut: tuple[str, ...] = ()
    open: tuple[str, ...] = ()
    carries: bool = True
    out_of_order: tuple[str, ...] = ()
    zones: tuple[str, ...] = ()
    out_of_reach: bool = False


class Roads(Struct, frozen=True, kw_only=True, tag="roads", tag_field="ask"):
    """Request the roadmap, and what of it is closed."""


class Traffic(Struct, frozen=True, kw_only=True, tag="traffic", tag_field="ask"):
    """Request where the robots may drive, and whom they wait for."""


class Idle(Struct, frozen=True, kw_only=True, tag="idle", tag_field="ask"):
    """Request an answer when all robots are idle."""


class Move(Struct, frozen=True, kw_only=True, tag="move", tag_field="ask"):
    """Move an object to another pose without a robot."""

    object: str
    x: float
    y: float
    z: float
    yaw: float = 0.0


class SetWeight(Struct, frozen=True, kw_only=True, tag="weight", tag_field="ask"):
    """Give an object another weight, in kg. The map does not learn of it."""

    object: str
    weight: Annotated[float, Meta(gt=0)]


class Follow(Struct, frozen=True, kw_only=True, tag="poses", tag_field="ask"):
    """Subscribe to the poses of everything that can move, at most `rate` lines per second of real time; 0 ends the subscription."""

    rate: Annotated[float, Meta(ge=0)] = 20.0


Question = Break | Repair | Look | Robots | Devices | Clock | Picture | Ways | Roads | Traffic | Idle | Move | SetWeight | Follow


class Ask(Struct, frozen=True, kw_only=True, tag="ask", tag_field="say"):
    """An operator's question or intervention. A robot's connection may send only `ways` of its own robot."""

    id: int
    question: Question


ClientLine = Hello | Order | Ask


class Welcome(Struct, frozen=True, kw_only=True, tag="welcome", tag_field="say"):
    """The answer to a hello that the server accepts."""

    protocol: str = PROTOCOL
    version: int = VERSION
    robot: str | None = None
    time: float


class State(Struct, frozen=True, kw_only=True, tag="state", tag_field="say"):
    """The robot's state, as a notification."""

    state: RobotState


class Unheard(Struct, frozen=True, kw_only=True, tag="unheard", tag_field="say"):
    """The simulator runs, and the robot is silent. Sent once per `HEARTBEAT` without a line from the robot."""


class Mover(Struct, frozen=True, kw_only=True):
    """Something that can move, and how many `numbers` describe its pose.

    1 or 2, a door or a container: how far each of its leaves is open, from 0 to 1. 4, a robot: x, y, z, yaw. 6, a thing: x, y, z, yaw,
    pitch, roll. 9, a robot with an arm: x, y, z, yaw; the angle of its turret; the height of its boom above its floor; the reach of its
    hand; the angle of its hand; the distance of each finger from the middle.
    """

    name: str
    numbers: int

    @property
    def is_thing(self) -> bool:
        return self.numbers == 6


class RobotStatus(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What a robot or a camera holds and does, and its faults."""

    holding: str | None = None
    activity: str | None = field(default=None, name="doing")
    faults: tuple[Fault, ...] = ()


class Poses(Struct, frozen=True, kw_only=True, omit_defaults=True, tag="poses", tag_field="say"):
    """The changes since the previous line, for a subscribed operator. Sent about once a second if nothing moves."""

    time: float
    """Simulated time, s."""
    clock: float
    """The simulator's monotonic clock in real time, s, with an arbitrary origin."""
    movers: tuple[Mover, ...] | None = None
    """Everything that can move: in the first line, and when the set changes. Such a line is complete."""
    moved: tuple[int, ...] = ()
    """Indices, from 0, of the movers that moved."""
    values: tuple[float, ...] = ()
    """The numbers of these movers, in the same order."""
    robots: dict[str, RobotStatus] = {}
    """The robots and cameras whose status changed."""


class OrderDone(Struct, frozen=True, kw_only=True, tag="done", tag_field="say"):
    """The command with this id was carried out."""

    id: int
    state: RobotState
    object_states: tuple[ObjectState, ...] = field(default=(), name="seen")
    sightings: tuple[Sighting, ...] = ()
    clear: tuple[int, ...] = ()
    ranges: tuple[float | None, ...] = ()


class OrderGivenUp(Struct, frozen=True, kw_only=True, tag="gave", tag_field="say"):
    """The command with this id was given up; the reasons are those of `CommandGivenUp`."""

    id: int
    reason: str
    description: str
    state: RobotState
    object_states: tuple[ObjectState, ...] = field(default=(), name="seen")
    sightings: tuple[Sighting, ...] = ()


class Answer(Struct, frozen=True, kw_only=True, tag="answer", tag_field="say"):
    """The answer to a question. Only the fields that the question requests are set."""

    id: int
    object_state: ObjectState | None = field(default=None, name="seen")
    robots: dict[str, RobotState] | None = None
    devices: dict[str, LinkedDevice] | None = None
    time: float | None = None
    speed: float | None = None
    """Simulated seconds per second; None: as fast as the processor allows."""
    png: bytes | None = None
    """In JSON: base64."""
    lengths: tuple[float | None, ...] | None = None
    """Length of each leg in metres; None from the first leg without a path on."""
    shut: tuple[str, ...] | None = None
    """The shut doors on the only way. The lengths are those of the way with these doors open."""
    open: tuple[str, ...] | None = None
    """The open doors on the only way."""
    carries: bool | None = None
    """Whether robots can put things on the last stop."""
    out_of_order: tuple[str, ...] | None = None
    """The doors and lifts that are out of order on the only way."""
    zones: tuple[str, ...] | None = None
    """The no-go zones on the only way."""
    out_of_reach: bool | None = None
    """Whether there is no point from which the robot would reach the first stop without a path."""
    roadmap: Roadmap | None = None
    traffic: TrafficState | None = None


class Refused(Struct, frozen=True, kw_only=True, tag="error", tag_field="say"):
    """A line cannot be processed. `reason` is for programs, `description` for people.

    After the reasons `too-long`, `hello-first`, `version`, `unknown-robot`, `taken`, `link-cut` and `failed` (the simulation), the server
    closes the connection. After `malformed`, `not-allowed`, `not-possible` and `no-graphics`, it stays open.
    """

    reason: str
    description: str
    id: int | None = None


ServerLine = Welcome | State | Unheard | Poses | OrderDone | OrderGivenUp | Answer | Refused

_opening = msgspec.json.Decoder(Opening)
_to_server: msgspec.json.Decoder[ClientLine] = msgspec.json.Decoder(ClientLine)
_to_client: msgspec.json.Decoder[ServerLine] = msgspec.json.Decoder(ServerLine)


def encode_line(line: ClientLine | ServerLine) -> bytes:
    """Encode a line, with its newline."""
    return msgspec.json.encode(line) + b"\n"


def read_opening(line: bytes) -> Opening:
    """Decode protocol and version from the first line of a client. Raises WireError."""
    try:
        return _opening.decode(line)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise WireError("hello-first", f"the first line must be a hello with a version: {error}") from None


def read_by_server(line: bytes) -> ClientLine:
    """Decode a line from a client. Raises WireError."""
    try:
        return _to_server.decode(line)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise WireError("malformed", f"not a line of {PROTOCOL} {VERSION}: {error}") from None


def read_by_client(line: bytes) -> ServerLine:
    """Decode a line from a server. Raises WireError."""
    try:
        return _to_client.decode(line)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise WireError("malformed", f"not a line of {PROTOCOL} {VERSION}: {error}") from None

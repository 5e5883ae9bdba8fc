"""ARCOS commands to a robot, and what it reports, as plain values.

Numbers are as the robot sends them: `parameters.py` has the factors to metres and radians. Sources: Pioneer 3 Operations Manual, chapter 6,
tables 4 (standard SIP), 6 (commands), 8 (FLAGS) and 9 (CONFIGpac); Pioneer Gripper Manual, tables 2 to 5.
"""

from __future__ import annotations

import struct
from enum import IntEnum, IntFlag

from msgspec import Struct

from somrs.adapters.arcos.packets import frame


class Command(IntEnum):
    """The commands that the adapter sends."""

    PULSE = 0
    """Nothing, but the robot's watchdog begins anew."""
    OPEN = 1
    """Start the servers of the robot."""
    CLOSE = 2
    """End the session."""
    ENABLE = 4
    """Motors on (1) or off (0)."""
    SETA = 5
    """The translational acceleration (positive) and deceleration (negative), mm/s²."""
    SETV = 6
    """The largest translational velocity, mm/s."""
    SETRV = 10
    """The largest rotational velocity, degrees/s."""
    VEL = 11
    """Translational velocity, mm/s; positive: forward."""
    CONFIG = 18
    """Request a Configuration."""
    RVEL = 21
    """Rotational velocity, degrees/s; positive: counter-clockwise."""
    SETRA = 23
    """The rotational acceleration (positive) and deceleration (negative), degrees/s²."""
    SONAR = 28
    """Sonar on (1) or off (0)."""
    STOP = 29
    """Stop; the motors stay on."""
    GRIPPER = 33
    """A GripperCommand."""
    GRIPREQUEST = 37
    """Request one GripperReport (1)."""
    BUMPSTALL = 44
    """Stall when bumpers touch something in the direction of the motion: never (0), front (1), rear (2), both (3)."""
    ESTOP = 55
    """Stop as fast as possible."""
    CHARGE = 68
    """Deploy (1) or release (0) the charging mechanism."""


SYNC = 0, 1, 2
"""Numbers of the synchronization packets, which begin a session."""


class GripperCommand(IntEnum):
    """Arguments of Command.GRIPPER."""

    OPEN = 1
    CLOSE = 2
    LIFT_UP = 4
    LIFT_DOWN = 5
    DEPLOY = 8
    """Open the paddles, and lower the lift."""
    HALT = 15


class Flag(IntFlag):
    """The bits of `Status.flags` that the adapter uses."""

    MOTORS = 1 << 0
    STOP_BUTTON = 1 << 5
    CHARGER_POWER = 1 << 10


class GripperState(IntFlag):
    """The bits of `Status.gripper`. If the paddles, or the lift, are both at one end and at the other, their position is not known."""

    OPEN = 1 << 0
    CLOSED = 1 << 1
    MOVING = 1 << 2
    ERROR = 1 << 3
    LIFT_UP = 1 << 4
    LIFT_DOWN = 1 << 5
    LIFT_MOVING = 1 << 6
    LIFT_ERROR = 1 << 7


class Beam(IntFlag):
    """The bits of `Status.inputs` that are set while something interrupts a break beam between the paddles."""

    OUTER = 1 << 2
    INNER = 1 << 3


class Status(Struct, frozen=True, kw_only=True):
    """The standard server information packet (SIP), which a robot sends every 100 ms.

    `x`, `y`: travel by the wheels' encoders, 16 bits that wrap around; `heading`: by the encoders, too. `left_speed`, `right_speed`: those
    of the wheels. `battery`: in tenths of a volt. `stall`: bits of stalled wheels and of bumpers. `sonar`: the new ranges by the number of
    the sonar disc. `gripper`, `inputs`: 0 from a robot that does not send them. `charge_state`: 0 is not charging, 3 is full; None: not
    sent.
    """

    is_moving: bool
    x: int
    y: int
    heading: int
    left_speed: int
    right_speed: int
    battery: int
    stall: int
    flags: int
    sonar: tuple[tuple[int, int], ...] = ()
    gripper: int = 0
    inputs: int = 0
    charge_state: int | None = None

    @property
    def has_charger_power(self) -> bool:
        return bool(self.flags & Flag.CHARGER_POWER or self.charge_state)

    @property
    def stalled_wheels(self) -> tuple[str, ...]:
        return tuple(side for side, bit in (("left", 1 << 0), ("right", 1 << 8)) if self.stall & bit)

    @property
    def bumpers(self) -> tuple[str, ...]:
        """Which of the rows of bumpers touch something: bits 9 to 15 are the front, bits 1 to 7 the rear."""
        return tuple(row for row, bits in (("front", 0xFE00), ("rear", 0x00FE)) if self.stall & bits)


class GripperReport(Struct, frozen=True, kw_only=True):
    """GRIPPERpac. `kind`: 0 is no gripper."""

    kind: int
    state: int
    grasp_time: int


class Configuration(Struct, frozen=True, kw_only=True):
    """The beginning of CONFIGpac: who the robot is, its largest velocities, in degrees/s and mm/s, and the time of its watchdog, ms; None:
    not sent."""

    kind: str
    subkind: str
    serial_number: str
    top_turning: int
    top_speed: int
    watchdog: int | None = None


class SyncReply(Struct, frozen=True, kw_only=True):
    """The echo of a synchronization packet. The last one has the robot's name, class and subclass."""

    number: int
    identity: tuple[str, ...] = ()


Report = Status | GripperReport | Configuration


def command(number: Command, argument: int | None = None) -> bytes:
    """The packet of a command. Arguments beyond 15 bits are limited to them."""
    if argument is None:
        return frame(bytes([number]))
    size = min(abs(argument), 0x7FFF)
    return frame(struct.pack("<BBH", number, 0x3B if argument >= 0 else 0x1B, size))


def sync(number: int) -> bytes:
    """A synchronization packet."""
    return frame(bytes([SYNC[number]]))


def sync_reply(body: bytes) -> SyncReply | None:
    """The answer to a synchronization packet; None if the body is something else."""
    if body[0] not in SYNC:
        return None
    parts = body[1:].split(b"\0")
    return SyncReply(number=body[0], identity=tuple(part.decode("ascii", "replace") for part in parts[:3] if part))


def report(body: bytes) -> Report | None:
    """What a robot reports with a packet; None if it is of another type, or is not complete."""
    match body[0]:
        case 0x32 | 0x33:
            return _status(body)
        case 0xE0 if len(body) >= 4:
            return GripperReport(kind=body[1], state=body[2], grasp_time=body[3])
        case 0x20:
            return _configuration(body)
    return None


_STATUS = struct.Struct("<BHHhhhBHhHBB")
_TAIL = struct.Struct("<BBBBB")
_TOPS = struct.Struct("<BHHHHH")
_EQUIPMENT = struct.Struct("<BBBHHBHHH")


def _status(body: bytes) -> Status | None:
    if len(body) < _STATUS.size:
        return None
    kind, x, y, heading, left_speed, right_speed, battery, stall, _control, flags, _compass, count = _STATUS.unpack_from(body)
    tail = _STATUS.size + 3 * count
    if len(body) < tail:
        return None
    gripper, _port, _analog, inputs, _outputs = _TAIL.unpack_from(body, tail) if len(body) >= tail + _TAIL.size else (0, 0, 0, 0, 0)
    # After the tail: the battery again as two bytes, which is right for batteries beyond 25.5 V, and the state of charging.
    extended = body[tail + _TAIL.size :]
    return Status(
        is_moving=kind == 0x33,
        x=x,
        y=y,
        heading=heading,
        left_speed=left_speed,
        right_speed=right_speed,
        battery=int.from_bytes(extended[:2], "little") if len(extended) >= 2 else battery,
        stall=stall,
        flags=flags,
        sonar=tuple(struct.unpack_from("<BH", body, _STATUS.size + 3 * index) for index in range(count)),
        gripper=gripper,
        inputs=inputs,
        charge_state=extended[2] if len(extended) >= 3 else None,
    )


def _configuration(body: bytes) -> Configuration | None:
    texts = body[1:].split(b"\0", 3)
    if len(texts) < 4 or len(texts[3]) < _TOPS.size:
        return None
    kind, subkind, serial_number = (text.decode("ascii", "replace") for text in texts[:3])
    _motors, turning, speed, *_ = _TOPS.unpack_from(texts[3])
    # The robot's name, and what it has.
    _name, _, equipment = texts[3][_TOPS.size :].partition(b"\0")
    watchdog = _EQUIPMENT.unpack_from(equipment)[-1] if len(equipment) >= _EQUIPMENT.size else None
    return Configuration(kind=kind, subkind=subkind, serial_number=serial_number, top_turning=turning, top_speed=speed, watchdog=watchdog)

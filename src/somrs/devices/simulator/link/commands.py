"""What can be said to a simulated robot and by it: commands, states, and how commands end. Plain values; the wire form of
them is `server.py`'s business, carrying them out `simulation.py`'s.

Positions are in metres on the map, angles in radians, times in seconds of simulated time.
"""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct, field


class DriveTo(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Drive to a place, around whatever is in the way; then turn to `yaw`, if it is given."""

    x: float
    y: float
    yaw: float | None = None


class Approach(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Drive to a free side of the object, so that the gripper can reach it, or can put something on it."""

    object: str


class Grip(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Take the object, which is within reach, and lift it to the transport position."""

    object: str


class Place(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Put what is held on the object in reach (a support, or a floor), let go, and back off. `x`, `y`: just there."""

    support: str = field(name="on")
    x: float | None = None
    y: float | None = None


class PutDown(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Lower what is held to the floor right here, and open clear of it. Works with a dead drive, too."""


class Sense(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Say what the camera sees from here, looking the way it looks: things, robots and furniture that nothing hides.

    `radius`: not farther than that; None: as far as the camera sees. Interrupts nothing.
    """

    radius: float | None = None


class LookAt(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Drive to where a point is in view, and turn to it. With `object`: end as soon as that is seen, on the way or there."""

    x: float
    y: float
    z: float
    object: str | None = None


class LookAround(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Turn once around, and say all that was seen meanwhile. With `object`: end as soon as that is seen."""

    object: str | None = None


class Stop(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Stop at once; what is held stays held."""


class Status(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Say the state now."""


Command = DriveTo | Approach | Grip | Place | PutDown | Sense | LookAt | LookAround | Stop | Status


class Fault(StrEnum):
    """What can be broken on command."""

    DRIVE = "drive"
    """The drive is dead: wheels stop at once and stay. Control unit, gripper and link work."""
    GRIPPER = "gripper"
    """The gripper is stuck as it is."""
    SILENT = "silent"
    """The robot stops, and says nothing any more, though its connection stands."""
    LINK = "link"
    """The connection is cut, and refused until repaired; the robot stops."""


class RobotState(Struct, frozen=True, kw_only=True):
    """What a robot reports of itself: pose, what it holds, what it is doing, its faults as far as it can say them."""

    time: float
    x: float
    y: float
    yaw: float
    holding: str | None = None
    activity: str | None = field(default=None, name="doing")
    faults: tuple[Fault, ...] = ()


class ObjectState(Struct, frozen=True, kw_only=True):
    """An object as sensors see it: the middle of its underside, what it stands on (None: held, or cannot tell), who holds it."""

    object: str
    x: float
    y: float
    z: float
    yaw: float
    support: str | None = field(default=None, name="on")
    held_by: str | None = None


class CommandDone(Struct, frozen=True, kw_only=True):
    """A command was carried out. `object_states`: what it touched or looked at, as it is now."""

    state: RobotState
    object_states: tuple[ObjectState, ...] = ()


class CommandGivenUp(Struct, frozen=True, kw_only=True):
    """A command was given up: a word for programs, a sentence for people, and what is known now.

    Reasons: `drive-dead`, `gripper-stuck`, `blocked` (no way there now), `unreachable` (no way there at all),
    `slipped` (it is not in the gripper), `unknown-object`, `not-holding`, `holding`, `no-space`, `stopped`, `not-possible`.
    """

    reason: str
    description: str
    state: RobotState
    object_states: tuple[ObjectState, ...] = ()

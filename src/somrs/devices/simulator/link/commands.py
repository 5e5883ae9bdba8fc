"""Commands to a simulated robot, their results, and the states that it reports, as plain values.

`lines.py` defines their wire form; `server/robot_work.py` carries the commands out. Positions are in metres on the map, angles in radians,
times in seconds of simulated time.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Annotated

from msgspec import Meta, Struct, field

from somrs.ontology.types import Value


class DriveTo(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Drive to a point around obstacles; then turn to `yaw`, if given. `z`: the height of its floor; None: the robot's own."""

    x: float
    y: float
    yaw: float | None = None
    z: float | None = None


class DriveAlong(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Drive in straight lines through points on the robot's floor, as far as traffic has granted them to the robot's own program; then turn
    to `yaw`, if given. It does not stop at points on the way. Only for robots that take part in traffic from outside (`Hello.outside`).

    `speed`: at most, in metres per second. `backward`: drive backwards.
    """

    points: tuple[tuple[float, float], ...]
    yaw: float | None = None
    speed: float | None = None
    backward: bool = False


class Velocity(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Drive with these velocities, in m/s and rad/s, for `lasts` seconds; then stop. Done after that time. Only for robots that take
    part in traffic from outside (`Hello.outside`)."""

    forward: float = 0.0
    turning: float = 0.0
    lasts: float = 0.5


class Approach(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Drive to a place from which the gripper can reach the object, or put something on it."""

    object: str


class Grip(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Grip the object, after driving within reach if necessary, and lift it to the transport position."""

    object: str


class Place(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Put the held object on a support or a floor, release it, and withdraw the arm. `x`, `y`: at this point; None: at a free spot."""

    support: str = field(name="on")
    x: float | None = None
    y: float | None = None


class Insert(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Put the held object into a container that is open, release it, and withdraw the arm."""

    container: str = field(name="into")


class Open(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Open the doors of the object by their handles, after driving within reach."""

    object: str


class Close(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Close the doors of the object by their handles, after driving within reach."""

    object: str


class MoveCabin(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Take the cabin of a lift to the floor of this height, as soon as no robot has the lift."""

    z: float


class ServePassage(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Open an automatic door, or take the cabin of a lift to the floor of the height `z` and open its doors, and keep them open. Only for
    doors and lifts that take part in traffic from outside (`Hello.outside`)."""

    z: float | None = None


class ReleasePassage(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Let a door, or the doors of a lift, shut that `ServePassage` keeps open."""


class Charge(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Charge the battery until it is full, on the charger at the current position."""


class PutDown(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Put the held object down within reach of the current position, and release it. Works without the drive."""


class Weigh(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Measure what the object weighs: a robot lifts it a little, after driving within reach; a scale weighs what stands on it alone."""

    object: str


class Likeness(Struct, frozen=True, kw_only=True):
    """What an object that is looked for looks like: its type, of which subtypes and super-types count too, and attributes by path."""

    type: str
    values: dict[str, Value] = {}


class Point(Struct, frozen=True, kw_only=True):
    """A point of the world, m."""

    x: float
    y: float
    z: float


class Sense(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Report what the camera sees in its current pose: things, robots and furniture that nothing hides.

    `radius`: largest distance; None: as far as the camera sees. `like`: mark what is alike. `expected`: points at which something should
    be; the result says which of them are in clear view. `furniture`: recognise furniture by its looks, too, for who does not know it by
    name; no sighting names anything then. Does not interrupt the command in progress.
    """

    radius: float | None = None
    like: Likeness | None = None
    expected: tuple[Point, ...] = ()
    furniture: bool = False


class Scan(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Measure distances in a plane, as a laser scanner does. Does not interrupt the command in progress.

    `rays`: how many, evenly over the field of `view`, rad: the number i, from 0, is at -view/2 + (i + 1/2) view / rays from the front.
    `range`: the greatest distance, m. `height`: of the plane above the floor, m.
    """

    rays: Annotated[int, Meta(ge=1, le=1440)] = 360
    view: Annotated[float, Meta(gt=0, le=math.tau)] = math.tau
    range: Annotated[float, Meta(gt=0)] = 10.0
    height: Annotated[float, Meta(ge=0)] = 0.2


class LookAt(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Drive to where a point is in view, and turn to it.

    With `object`, a landmark, or `like`: end as soon as it, or something like it, is seen, also on the way. `whole`: do not end early, and
    only mark what is alike.
    """

    x: float
    y: float
    z: float
    object: str | None = None
    like: Likeness | None = None
    whole: bool = False


class LookAround(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Turn once around, and report everything that came into view. With `object`, `like` and `whole` as in LookAt."""

    object: str | None = None
    like: Likeness | None = None
    whole: bool = False


class Stop(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Stop at once, and keep the object that is held. The handle of a door is released."""


class Status(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Report the current state."""


Command = (
    DriveTo
    | DriveAlong
    | Velocity
    | Approach
    | Grip
    | Place
    | Insert
    | Open
    | Close
    | MoveCabin
    | ServePassage
    | ReleasePassage
    | Charge
    | PutDown
    | Weigh
    | Sense
    | Scan
    | LookAt
    | LookAround
    | Stop
    | Status
)


class Fault(StrEnum):
    """Faults that can be injected."""

    DRIVE = "drive"
    """The drive fails: the wheels stop at once. Control unit, gripper and link work."""
    GRIPPER = "gripper"
    """The gripper stays as it is."""
    SILENT = "silent"
    """The robot stops, and sends nothing more; its connection stays open."""
    LINK = "link"
    """The robot stops. Its connection is cut, and refused until the fault is repaired."""


MUTING = frozenset({Fault.SILENT, Fault.LINK})
"""The faults that keep a device from sending anything."""


class RobotState(Struct, frozen=True, kw_only=True):
    """The state that a robot reports: time, pose, held object, command in progress, faults as far as it can report them, and battery.

    `z`: the height of the floor on which it stands; None from a robot that does not know it.
    """

    time: float
    x: float
    y: float
    yaw: float
    holding: str | None = None
    activity: str | None = field(default=None, name="doing")
    faults: tuple[Fault, ...] = ()
    z: float | None = None
    charge: float | None = None
    """Charge of its battery, percent; None for a device without one."""
    hindrance: str | None = None
    """What keeps it from going on, and will pass without it: that the lift in which it stands does not work, for example."""
    obstructed: bool = False
    """Whether something stands in the way of the motion that it was told."""
    trouble: str | None = None
    """Why it has its faults, as a sentence; None: they say all."""
    remark: str | None = None
    """What it says of itself that does not keep it from going on: that a sensor is dirty, for example."""


class LinkedDevice(Struct, frozen=True, kw_only=True):
    """A device of the simulated world with a robot link: its state, and the faults that it can have."""

    state: RobotState
    possible_faults: tuple[Fault, ...]


class ObjectState(Struct, frozen=True, kw_only=True):
    """An observed object: the middle of its underside, its yaw, and its support, its container or its holder, as far as they are known."""

    object: str
    x: float
    y: float
    z: float
    yaw: float
    support: str | None = field(default=None, name="on")
    held_by: str | None = None
    container: str | None = field(default=None, name="in")
    open: bool | None = None
    """Whether a door or a container stands open."""
    weight: float | None = None
    """What it weighs, kg, if the command has lifted or weighed it."""


class Sighting(Struct, frozen=True, kw_only=True):
    """A thing or a robot as a camera recognises it: without its name.

    `values`: colour, form and sizes, by attribute path; the pose is that of the middle of its underside. All are measured with the camera's
    noise. `support` and `container`: the landmark that it is on or in; `held_by`: the position, in the same result, of the robot that
    holds it. `robot`, `furniture`: whether it is one, or a piece of it. `alike`: whether it looks like what the command was to look for.
    """

    type: str
    values: dict[str, Value] = {}
    robot: bool = False
    furniture: bool = False
    alike: bool = False
    x: float
    y: float
    z: float
    yaw: float
    support: str | None = None
    container: str | None = None
    held_by: int | None = None


class CommandDone(Struct, frozen=True, kw_only=True):
    """A command was carried out. `object_states`: the objects that it touched, and landmarks that it saw. `sightings`: what else it saw.

    `clear`: the positions, in the command, of the expected points that nothing hides. `ranges`: the distance along each ray of a scan, m;
    None: nothing is within its range.
    """

    state: RobotState
    object_states: tuple[ObjectState, ...] = ()
    sightings: tuple[Sighting, ...] = ()
    clear: tuple[int, ...] = ()
    ranges: tuple[float | None, ...] = ()


class CommandGivenUp(Struct, frozen=True, kw_only=True):
    """A command was given up. `reason` is for programs, `description` for people.

    Reasons: `drive-dead`, `battery-empty`, `gripper-stuck`, `blocked` (no free path at present), `unreachable` (no path at all),
    `slipped` (the object is not in the gripper), `too-heavy`, `unknown-object`, `not-holding`, `holding`, `no-space`,
    `shut` (the container), `stopped`, `not-possible`.
    """

    reason: str
    description: str
    state: RobotState
    object_states: tuple[ObjectState, ...] = ()
    sightings: tuple[Sighting, ...] = ()

"""What goes into the driver of a robot, and what comes out of it."""

from __future__ import annotations

from msgspec import Struct

from somrs.adapters.arcos.messages import GripperCommand
from somrs.adapters.arcos.odometry import Pose
from somrs.devices.road_robot import Way

# Inputs.


class Connected(Struct, frozen=True):
    """There is a line to the robot."""


class Disconnected(Struct, frozen=True):
    """There is no line to the robot, or not any more; why, for people."""

    problem: str | None = None


class Received(Struct, frozen=True):
    """Bytes from the robot."""

    data: bytes


class Tick(Struct, frozen=True):
    """Time has passed. The driver needs one at least every 100 ms."""


class Follow(Struct, frozen=True):
    """Drive along a way, up to its last released waypoint."""

    way: Way


class Halt(Struct, frozen=True):
    """End what the robot does, and stand. Answered with Halted."""


class TurnTo(Struct, frozen=True):
    """Turn on the spot, to a yaw on the map, rad."""

    yaw: float


class Advance(Struct, frozen=True, kw_only=True):
    """Drive straight ahead, slowly: this far, m (negative: back). `until_beam`: only until something is between the paddles."""

    distance: float
    until_beam: bool = False


class MoveGripper(Struct, frozen=True):
    """Move the paddles or the lift of the gripper to an end."""

    move: GripperCommand


class FillBattery(Struct, frozen=True):
    """Charge until the battery is full."""


Action = TurnTo | Advance | MoveGripper | FillBattery
"""What a robot does while it follows no way. Answered with ActionDone or ActionFailed."""


class Quit(Struct, frozen=True):
    """Stop the robot, and end the session."""


Input = Connected | Disconnected | Received | Tick | Follow | Halt | Action | Quit

# Effects.


class Transmit(Struct, frozen=True):
    """Send bytes to the robot."""

    data: bytes


class Heard(Struct, frozen=True):
    """The robot can be reached, or not any more; why not, for people, as far as it is known."""

    is_connected: bool
    problem: str | None = None


class Located(Struct, frozen=True):
    """The robot is at this pose on the map."""

    pose: Pose


class LineIsPoor(Struct, frozen=True):
    """This share of what comes from the robot is damaged, from 0 to 1; None: hardly anything, again."""

    share: float | None


class Passed(Struct, frozen=True):
    """The robot has come to a waypoint."""

    number: int


class GaveUp(Struct, frozen=True):
    """The robot stands, and does not go on along its way."""

    description: str


class Broken(Struct, frozen=True):
    """The robot cannot drive, for a reason; None: it can again."""

    reason: str | None


class Halted(Struct, frozen=True):
    """The robot stands, as it was told."""


class ActionDone(Struct, frozen=True, kw_only=True):
    """An action is over. `is_occupied`: whether something is between the paddles."""

    is_occupied: bool = False


class ActionFailed(Struct, frozen=True, kw_only=True):
    """An action was given up."""

    description: str


class Holds(Struct, frozen=True):
    """Whether the paddles have closed around something: when the robot is connected, and when that has changed."""

    something: bool


class BatteryLevel(Struct, frozen=True):
    """The charge of the battery, in percent, when it has changed by 1 or more."""

    charge: int


Effect = Transmit | Heard | Located | Passed | GaveUp | Broken | Halted | ActionDone | ActionFailed | BatteryLevel | Holds | LineIsPoor

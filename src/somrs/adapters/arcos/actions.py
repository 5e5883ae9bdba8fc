"""What a robot does besides following ways: it turns, approaches, moves its gripper, and charges. Each is told with every report what to do
next, until it is over."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

from somrs.adapters.arcos.events import (
    Action,
    ActionDone,
    ActionFailed,
    Advance,
    FillBattery,
    MoveGripper,
    TurnTo,
)
from somrs.adapters.arcos.gripper import GripperFailed, GripperMove, holds, is_occupied
from somrs.adapters.arcos.messages import Command, Status
from somrs.adapters.arcos.odometry import Pose, wrap
from somrs.adapters.arcos.parameters import Parameters
from somrs.adapters.arcos.steering import STAND, Speeds, speed_for, turn_speeds

Send = Callable[[Command, int], None]

TURNED = math.radians(1)
"""A turn is over with this error, rad."""
ARRIVED = 0.005
"""An approach is over with this error, m."""
APPROACH_SPEED = 0.1
"""Speed with which a robot drives to what it handles, m/s."""
FULL = 3
"""`Status.charge_state` of a battery that is full."""
CHARGER_PATIENCE = 150
"""Reports within which a charger has to give power."""


class RunningAction(Protocol):
    """An action in progress."""

    def update(self, status: Status, pose: Pose, send: Send) -> Speeds | ActionDone | ActionFailed:
        """Take in a report, and return the velocities for now, or how the action ended."""


class _Turn:
    def __init__(self, action: TurnTo, parameters: Parameters) -> None:
        self._yaw, self._parameters = action.yaw, parameters

    def update(self, status: Status, pose: Pose, send: Send) -> Speeds | ActionDone | ActionFailed:
        error = wrap(self._yaw - pose.yaw)
        if abs(error) > TURNED:
            return turn_speeds(error, self._parameters)
        return ActionDone() if is_standing(status) else STAND


class _Straight:
    def __init__(self, action: Advance, parameters: Parameters) -> None:
        self._action, self._parameters = action, parameters
        self._start: Pose | None = None

    def update(self, status: Status, pose: Pose, send: Send) -> Speeds | ActionDone | ActionFailed:
        self._start = start = self._start or pose
        travel = (pose.x - start.x) * math.cos(start.yaw) + (pose.y - start.y) * math.sin(start.yaw)
        remaining = self._action.distance - travel
        direction = math.copysign(1.0, self._action.distance)
        has_arrived = remaining * direction <= ARRIVED or (self._action.until_beam and is_occupied(status))
        if has_arrived:
            return ActionDone(is_occupied=is_occupied(status)) if is_standing(status) else STAND
        speed = speed_for(abs(remaining), self._parameters, APPROACH_SPEED)
        turning = max(-0.2, min(0.2, wrap(start.yaw - pose.yaw)))
        return Speeds(forward=direction * speed, turning=turning)


class _Gripping:
    def __init__(self, action: MoveGripper) -> None:
        self._move = GripperMove(action.move)

    def update(self, status: Status, pose: Pose, send: Send) -> Speeds | ActionDone | ActionFailed:
        if self._move.is_over(status):
            return ActionDone(is_occupied=holds(status))
        try:
            move = self._move.update(status)
        except GripperFailed as failure:
            return ActionFailed(description=failure.description)
        if move is not None:
            send(Command.GRIPPER, move)
        return STAND


class _Charging:
    def __init__(self) -> None:
        self._reports = 0
        self._had_power = False

    def update(self, status: Status, pose: Pose, send: Send) -> Speeds | ActionDone | ActionFailed:
        has_power = status.has_charger_power
        if has_power and status.charge_state == FULL:
            send(Command.CHARGE, 0)
            return ActionDone()
        self._had_power = self._had_power or has_power
        self._reports = 0 if has_power else self._reports + 1
        if self._reports > CHARGER_PATIENCE:
            send(Command.CHARGE, 0)
            return ActionFailed(description=f"the charger {'stopped giving' if self._had_power else 'gives no'} power")
        if self._reports % 20 == 1:
            send(Command.CHARGE, 1)
        return STAND


def begin(action: Action, parameters: Parameters) -> RunningAction:
    """Begin an action."""
    match action:
        case TurnTo():
            return _Turn(action, parameters)
        case Advance():
            return _Straight(action, parameters)
        case MoveGripper():
            return _Gripping(action)
        case FillBattery():
            return _Charging()


def is_standing(status: Status) -> bool:
    """Whether both wheels stand."""
    return abs(status.left_speed) <= 1 and abs(status.right_speed) <= 1

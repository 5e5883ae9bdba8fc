"""What a robot does when its motors stall: it draws back a little. That tells what it pushed against from a drive that is broken."""

from __future__ import annotations

import math
from enum import Enum, auto

from somrs.adapters.arcos.actions import Send, is_standing
from somrs.adapters.arcos.messages import Command, Flag, Status
from somrs.adapters.arcos.steering import STAND, Speeds

REST = 10
"""Reports for which stalled motors rest: the controller itself lets them rest for about half a second (StallCount)."""
PATIENCE = 20
"""Reports within which a robot that draws back has to move, or to stall again."""
MOVES = 2
"""Reports of motion, one after the other, after which a robot is free. It has moved by about two centimetres then."""
FORWARD, TURNING = 0.08, math.radians(10)
"""How fast it draws back, m/s and rad/s."""

STUCK = "its motors stall in both directions, and are off: press its MOTORS button when it is mended"


class Diagnosis(Enum):
    """What drawing back has shown."""

    FREE = auto()
    """The robot moves: something was in its way."""
    STUCK = auto()
    """Its motors stall in the other direction, too."""
    STILL = auto()
    """It neither moves nor stalls: it does not hear what it is told, for example."""


class DrawingBack:
    """A robot that draws back. `problem`: why it was stopped; `speeds`: with which it was told to move then."""

    def __init__(self, problem: str, speeds: Speeds) -> None:
        self.problem = problem
        self._reports = self._moves = 0
        self._speeds = (
            Speeds(forward=-math.copysign(FORWARD, speeds.forward))
            if speeds.forward
            else Speeds(turning=-math.copysign(TURNING, speeds.turning))
        )

    def update(self, status: Status) -> Speeds | Diagnosis:
        """Take in a report, and return the velocities for now, or what it has shown."""
        self._reports += 1
        if self._reports == REST and status.stalled_wheels:
            return Diagnosis.STILL  # it has not heard that it is to stand, and pushes on
        if self._reports <= REST:
            return STAND
        self._moves = 0 if is_standing(status) else self._moves + 1
        if self._moves >= MOVES:
            return Diagnosis.FREE
        if status.stalled_wheels and self._reports > REST + MOVES:
            return Diagnosis.STUCK
        return self._speeds if self._reports < REST + PATIENCE else Diagnosis.STILL


class Standstill:
    """The motors of a robot that is stuck are off, until a person switches them on."""

    def __init__(self) -> None:
        self._were_off = False

    def is_over(self, status: Status, send: Send) -> bool:
        """Take in a report; motors that are still on are switched off. Returns whether a person has switched them on again."""
        are_on = bool(status.flags & Flag.MOTORS)
        if are_on and not self._were_off:
            send(Command.ENABLE, 0)
        self._were_off = self._were_off or not are_on
        return are_on and self._were_off

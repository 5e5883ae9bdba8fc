"""What a robot does when its motors stall, or when its bumpers touch something: it draws back a little. That tells what it pushed against
from a drive that is broken."""

from __future__ import annotations

import math
from collections.abc import Collection
from enum import Enum, auto

from somrs.adapters.arcos.actions import is_standing
from somrs.adapters.arcos.messages import Status
from somrs.adapters.arcos.steering import STAND, Speeds

REST = 10
"""Reports for which stalled motors rest: the controller itself lets them rest for about half a second (StallCount)."""
PATIENCE = 20
"""Reports within which a robot that draws back has to move, or to stall again."""
MOVES, MOST_MOVES = 2, 6
"""Reports of motion, one after the other, after which a robot is free, if its bumpers are, and after which it goes no farther. It has moved
by about two and five centimetres then."""
FORWARD, TURNING = 0.08, math.radians(10)
"""How fast it draws back, m/s and rad/s."""


class Diagnosis(Enum):
    """What drawing back has shown."""

    FREE = auto()
    """The robot moves: something was in its way."""
    STUCK = auto()
    """Its motors stall in the other direction, too."""
    STILL = auto()
    """It neither moves nor stalls: it does not hear what it is told, for example. Or something touches it still."""


def touched(bumpers: Collection[str]) -> str:
    """That bumpers touch something, for people."""
    return f"its {' and '.join(bumpers)} bumpers touch something"


def is_towards(bumpers: Collection[str], speeds: Speeds) -> bool:
    """Whether velocities lead to what the bumpers touch. A robot that turns on the spot sweeps along with all of them."""
    if speeds.forward:
        return ("front" if speeds.forward > 0 else "rear") in bumpers
    return bool(bumpers) and speeds != STAND


class DrawingBack:
    """A robot that draws back. `problem`: why it was stopped; `speeds`: with which it was told to move then; `bumpers`: that touch
    something."""

    def __init__(self, problem: str, speeds: Speeds, bumpers: Collection[str] = ()) -> None:
        self.problem = problem
        self._reports = self._moves = 0
        if bumpers:
            self._speeds = Speeds(forward=-FORWARD if "front" in bumpers else FORWARD)
        elif speeds.forward:
            self._speeds = Speeds(forward=-math.copysign(FORWARD, speeds.forward))
        else:
            self._speeds = Speeds(turning=-math.copysign(TURNING, speeds.turning))

    def update(self, status: Status) -> Speeds | Diagnosis:
        """Take in a report, and return the velocities for now, or what it has shown."""
        self._reports += 1
        if self._reports == REST and status.stalled_wheels:
            return Diagnosis.STILL  # it has not heard that it is to stand, and pushes on
        if self._reports <= REST:
            return STAND
        if is_towards(status.bumpers, self._speeds):
            return Diagnosis.STILL
        self._moves = 0 if is_standing(status) else self._moves + 1
        if self._moves >= (MOST_MOVES if status.bumpers else MOVES):
            return Diagnosis.FREE if not status.bumpers else Diagnosis.STILL
        if status.stalled_wheels and self._reports > REST + MOVES:
            return Diagnosis.STUCK
        return self._speeds if self._reports < REST + PATIENCE else Diagnosis.STILL

"""The simulated 2-DOF gripper: paddles that close around a thing, and a lift (Pioneer Gripper Manual, tables 2 to 4)."""

from __future__ import annotations

from somrs.adapters.arcos.simulated.body import Body

PADDLE_TIME, LIFT_TIME = 3.0, 4.0
"""Seconds from one end to the other."""
GRASP = 0.4
"""Where paddles stop that have something between them: 0 is open, 1 is closed."""


class Gripper:
    """Positions go from 0 (open, down) to 1 (closed, up); goals are None while nothing moves."""

    def __init__(self, body: Body) -> None:
        self._body = body
        self._paddles, self._lift = GRASP if body.is_holding else 1.0, 1.0
        self._paddle_goal: float | None = None
        self._lift_goal: float | None = None
        self._has_slipped = False
        """Whether what is between the paddles did not stay there when they closed."""
        self.is_stuck = False
        """A fault: it does not move."""

    def command(self, number: int) -> None:
        match number:
            case 1:  # open
                self._paddle_goal = 0.0
                self._body.release()
            case 2:  # close
                self._paddle_goal, self._has_slipped = 1.0, False
            case 4:  # lift up
                self._lift_goal = 1.0
            case 5:  # lift down
                self._lift_goal = 0.0
            case 8:  # deploy
                self.command(1)
                self.command(5)
            case 3 | 6 | 15:  # stop the paddles, the lift, or both
                self._paddle_goal = self._paddle_goal if number == 6 else None
                self._lift_goal = self._lift_goal if number == 3 else None

    def advance(self, duration: float) -> None:
        """So many seconds pass."""
        if self.is_stuck:
            return
        if self._paddle_goal is not None and not self._body.is_handling:
            has_thing = self._body.is_holding or (self._body.has_thing and not self._has_slipped)
            stop = GRASP if self._paddle_goal == 1.0 and has_thing else self._paddle_goal
            was_stopped = self._paddles == stop
            self._paddles = _towards(self._paddles, stop, duration / PADDLE_TIME)
            if stop == GRASP and self._paddles == stop and not was_stopped:
                self._body.grip()
            elif stop == GRASP and self._paddles == stop and not self._body.is_holding:
                self._has_slipped = True
            elif self._paddles == stop:
                self._paddle_goal = None
        if self._lift_goal is not None:
            self._lift = _towards(self._lift, self._lift_goal, duration / LIFT_TIME)
            if self._lift == self._lift_goal:
                self._lift_goal = None

    @property
    def state(self) -> int:
        """The state byte."""
        paddles = (self._paddles == 0.0) | (self._paddles == 1.0) << 1 | (self._paddle_goal is not None and not self.is_stuck) << 2
        lift = (self._lift == 1.0) | (self._lift == 0.0) << 1 | (self._lift_goal is not None and not self.is_stuck) << 2
        return paddles | lift << 4

    @property
    def inputs(self) -> int:
        """The digital inputs of the beams and switches."""
        beams = 0b1100 if self._body.has_thing else 0
        is_open = 0b110000 if self._paddles < GRASP else 0
        return beams | is_open


def _towards(value: float, goal: float, step: float) -> float:
    return goal if abs(goal - value) <= step else value + (step if goal > value else -step)

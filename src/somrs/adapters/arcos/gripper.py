"""Moves of the 2-DOF gripper: what is sent, and when a move is over. Counted in reports, of which there are ten a second."""

from __future__ import annotations

from somrs.adapters.arcos.messages import Beam, GripperCommand, GripperState, Status

PATIENCE = 10
"""A gripper that has not moved in so many reports is told again."""
TRIES = 5
_ENDS = {
    GripperCommand.OPEN: GripperState.OPEN,
    GripperCommand.CLOSE: GripperState.CLOSED,
    GripperCommand.LIFT_UP: GripperState.LIFT_UP,
    GripperCommand.LIFT_DOWN: GripperState.LIFT_DOWN,
    GripperCommand.DEPLOY: GripperState.OPEN | GripperState.LIFT_DOWN,
}
_PADDLES = GripperState.OPEN | GripperState.CLOSED
_LIFT = GripperState.LIFT_UP | GripperState.LIFT_DOWN


def is_occupied(status: Status) -> bool:
    """Whether something interrupts a beam between the paddles."""
    return bool(status.inputs & (Beam.INNER | Beam.OUTER))


def holds(status: Status) -> bool:
    """Whether the paddles have closed around something: open ones can stand around a thing that they have let go, and closed ones before
    one."""
    return is_occupied(status) and not status.gripper & (GripperState.OPEN | GripperState.CLOSED | GripperState.MOVING)


class GripperFailed(Exception):
    """A move of the gripper has come to no end. `description`: why, for people."""

    def __init__(self, description: str) -> None:
        self.description = description
        super().__init__(description)


class GripperMove:
    """One move of the gripper."""

    def __init__(self, move: GripperCommand) -> None:
        self.move = move
        end = _ENDS[move]
        self._moves_lift, self._moves_paddles = bool(end & _LIFT), bool(end & _PADDLES)
        self._moving = GripperState.LIFT_MOVING * self._moves_lift | GripperState.MOVING * self._moves_paddles
        self._error = GripperState.LIFT_ERROR * self._moves_lift | GripperState.ERROR * self._moves_paddles
        self._end = end
        self._opposite = (_LIFT * self._moves_lift | _PADDLES * self._moves_paddles) & ~end
        self._idle_reports = PATIENCE
        self._tries = 0
        self._reports = 0

    def update(self, status: Status) -> GripperCommand | None:
        """Take in a report, and return what is to be sent: the command, for the first time or again. Raises GripperFailed."""
        if status.gripper & self._error:
            raise GripperFailed(f"the {self._part} of its gripper reported an error")
        self._reports += 1
        self._idle_reports = 0 if status.gripper & self._moving else self._idle_reports + 1
        if self._idle_reports < PATIENCE:
            return None
        if self._tries == TRIES:
            raise GripperFailed(f"the {self._part} of its gripper did not move")
        self._idle_reports, self._tries = 0, self._tries + 1
        return self.move

    def is_over(self, status: Status) -> bool:
        """Whether the gripper stands where the move ends. Paddles that close also end at what is between them."""
        if not self._tries or status.gripper & self._moving:
            return False
        if status.gripper & self._end == self._end and not status.gripper & self._opposite:
            return True
        # Paddles around a thing are neither open nor closed. Two reports, so that they have begun to move.
        is_closing = self.move is GripperCommand.CLOSE and not status.gripper & GripperState.OPEN
        return is_closing and is_occupied(status) and self._reports > 2

    @property
    def _part(self) -> str:
        return "lift" if not self._moves_paddles else "paddles" if not self._moves_lift else "paddles or lift"

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
}
_LIFTS = {GripperCommand.LIFT_UP, GripperCommand.LIFT_DOWN}


def is_occupied(status: Status) -> bool:
    """Whether something interrupts a beam between the paddles."""
    return bool(status.inputs & (Beam.INNER | Beam.OUTER))


class GripperFailed(Exception):
    """A move of the gripper has come to no end. `description`: why, for people."""

    def __init__(self, description: str) -> None:
        self.description = description
        super().__init__(description)


class GripperMove:
    """One move of the gripper."""

    def __init__(self, move: GripperCommand) -> None:
        self.move = move
        self._is_lift = move in _LIFTS
        self._idle_reports = PATIENCE
        self._tries = 0
        self._reports = 0

    def update(self, status: Status) -> GripperCommand | None:
        """Take in a report, and return what is to be sent: the command, for the first time or again. Raises GripperFailed."""
        state = GripperState(status.gripper)
        if state & (GripperState.LIFT_ERROR if self._is_lift else GripperState.ERROR):
            raise GripperFailed(f"the {'lift' if self._is_lift else 'paddles'} of its gripper reported an error")
        self._reports += 1
        is_moving = state & (GripperState.LIFT_MOVING if self._is_lift else GripperState.MOVING)
        self._idle_reports = 0 if is_moving else self._idle_reports + 1
        if self._idle_reports < PATIENCE:
            return None
        if self._tries == TRIES:
            raise GripperFailed(f"the {'lift' if self._is_lift else 'paddles'} of its gripper did not move")
        self._idle_reports, self._tries = 0, self._tries + 1
        return self.move

    def is_over(self, status: Status) -> bool:
        """Whether the gripper stands where the move ends. Paddles that close also end at what is between them."""
        state = GripperState(status.gripper)
        if not self._tries or state & (GripperState.LIFT_MOVING if self._is_lift else GripperState.MOVING):
            return False
        if state & _ENDS[self.move] and not state & self._opposite():
            return True
        # Paddles around a thing are neither open nor closed. Two reports, so that they have begun to move.
        is_closing = self.move is GripperCommand.CLOSE and not state & GripperState.OPEN
        return is_closing and is_occupied(status) and self._reports > 2

    def _opposite(self) -> GripperState:
        ends = (GripperState.LIFT_UP | GripperState.LIFT_DOWN) if self._is_lift else (GripperState.OPEN | GripperState.CLOSED)
        return ends & ~_ENDS[self.move]

"""Orders that a vehicle rejects, one after another."""

from __future__ import annotations

import math

from somrs.adapters.vda5050.control.condition import ABOUT_MESSAGES, REJECTIONS, plain_type
from somrs.adapters.vda5050.messages.states import State

ENOUGH = 3
"""Orders in a row that a vehicle has to reject to be taken for one that rejects the next one, too."""
RETRY, LONGEST_RETRY = 60.0, 600.0
"""Seconds after which such a vehicle gets an order again: for the first time, and at most."""
MOVED = 0.5
"""A vehicle that was moved by as much may take an order again, m."""


class Refusals:
    """Those of one vehicle. `reason`: why it gets no order now; None: it does."""

    def __init__(self) -> None:
        self.reason: str | None = None
        self._count = 0
        self._state: State | None = None
        self._retry_time = math.inf

    def add(self, words: str, state: State, now: float) -> None:
        """The vehicle has rejected an order, with these words."""
        self._count += 1
        self._state = state
        if self._count >= ENOUGH:
            self.reason = f"rejects its orders: {words}"
            self._retry_time = now + float(min(RETRY * 2 ** (self._count - ENOUGH), LONGEST_RETRY))

    def clear(self) -> None:
        """The vehicle has taken an order, or has been started."""
        self.reason, self._count, self._state = None, 0, None

    def review(self, state: State | None, now: float) -> None:
        """Give the vehicle an order again if something has changed, or after a while."""
        if self._state is None or state is None:
            return
        if _differ(self._state, state):
            self.clear()
        elif now >= self._retry_time:
            self.reason = None


def _differ(first: State, second: State) -> bool:
    """Whether a vehicle with the one state may take an order that it rejects with the other."""
    return _circumstances(first) != _circumstances(second) or _distance(first, second) > MOVED


def _circumstances(state: State) -> tuple[object, ...]:
    position = state.mobile_robot_position
    errors = {error.error_type for error in state.errors if plain_type(error) not in REJECTIONS | ABOUT_MESSAGES}
    return position.map_id if position is not None else "", state.operating_mode, errors, state.maps, state.loads


def _distance(first: State, second: State) -> float:
    poses = [state.mobile_robot_position for state in (first, second)]
    points = [(pose.x, pose.y) for pose in poses if pose is not None]
    return math.dist(*points) if len(points) == len(poses) else 0.0

"""The time of a whole system in one process, and the actions that are due."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable


class VirtualClock:
    """Seconds since 1970, which pass only in `run`."""

    def __init__(self, start: float) -> None:
        self.now = start
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._count = itertools.count()

    def run(self, seconds: float, until: Callable[[], bool]) -> bool:
        """Let time pass until the condition holds, for `seconds`, or until no event is left. Return whether the condition holds."""
        end = self.now + seconds
        while not until():
            if not self._events or self._events[0][0] > end:
                self.now = end
                return until()
            self.now, _, action = heapq.heappop(self._events)
            action()
        return True

    def schedule(self, due_time: float, action: Callable[[], None]) -> None:
        """Call the action at this time; at once, after what is already due, if it is over."""
        heapq.heappush(self._events, (max(due_time, self.now), next(self._count), action))

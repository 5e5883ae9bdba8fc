"""The timers of a component, on the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Hashable

from somrs.runtime.clock import Clock

LATE = 0.5
"""Seconds after its time from which a timer is late: the process was held up. Inputs that arrived meanwhile go before the timer."""

GRACE = 1.0
"""Seconds for such inputs to be read, at most."""


class Timers:
    """Each timer fires once, at its time on `clock`, unless it is set again: `fire` is called with it."""

    def __init__(self, clock: Clock, fire: Callable[[Hashable], None]) -> None:
        self._clock, self._fire = clock, fire
        self._handles: dict[Hashable, asyncio.TimerHandle] = {}

    def set(self, timer: Hashable, fire_time: float | None) -> None:
        """Set a timer, or with None cancel it."""
        if (old := self._handles.pop(timer, None)) is not None:
            old.cancel()
        if fire_time is not None:
            delay = max(0.0, fire_time - self._clock.now())
            self._handles[timer] = asyncio.get_running_loop().call_later(delay, self._expire, timer, fire_time)

    def cancel_all(self) -> None:
        """Let none of them fire."""
        for handle in self._handles.values():
            handle.cancel()
        self._handles.clear()

    def _expire(self, timer: Hashable, fire_time: float | None) -> None:
        """Fire a timer. One that is late waits once: what it says is missing may have arrived, and is not read yet."""
        if fire_time is not None and (lateness := self._clock.now() - fire_time) > LATE:
            self._handles[timer] = asyncio.get_running_loop().call_later(min(lateness, GRACE), self._expire, timer, None)
            return
        self._handles.pop(timer, None)
        self._fire(timer)

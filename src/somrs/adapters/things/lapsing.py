"""What becomes of a value when its thing says nothing more: TRUE goes back to FALSE, or it is not known any more."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from somrs.adapters.things.model import Signal
from somrs.adapters.things.state import News, ThingState

Action = Callable[[ThingState, Signal], None]


class Lapses:
    """The values that lapse. `reset`: is called when a value goes back to FALSE (`off_delay`); `expire`: when it counts no more
    (`expire_after`)."""

    def __init__(self, reset: Action, expire: Action) -> None:
        self._reset, self._expire = reset, expire
        self._timers: dict[tuple[str, str], list[asyncio.TimerHandle]] = {}
        """By names of things, and paths."""

    def heard(self, news: News) -> None:
        """Count anew from this value on."""
        signal = news.signal
        if signal is None or (signal.off_delay is None and signal.expire_after is None):
            return
        key, loop = (news.state.thing.name, signal.path), asyncio.get_running_loop()
        for timer in self._timers.get(key, ()):
            timer.cancel()
        timers = self._timers[key] = []
        if signal.off_delay is not None and news.value is True:
            timers.append(loop.call_later(signal.off_delay, self._reset, news.state, signal))
        if signal.expire_after is not None:
            timers.append(loop.call_later(signal.expire_after, self._expire, news.state, signal))

    def drop(self, name: str) -> None:
        """Forget a thing, which has gone."""
        for key in [key for key in self._timers if key[0] == name]:
            for timer in self._timers.pop(key):
                timer.cancel()

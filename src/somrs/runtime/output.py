"""The output of a component: its effects, in order, each performed only when everything it may depend on is on disk."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from somrs.errors import RemoteError
from somrs.kernel.component import Effect
from somrs.storage.disk import Disk

log = logging.getLogger(__name__)

Acknowledge = Callable[[RemoteError | None], None]
"""Receives None when the input is on disk, or the error for which it is not."""


class _HeldEffect(NamedTuple):
    """An effect with its message's number, or a callback, that waits until `position` is on disk."""

    position: int
    effect: Effect | None
    number: int
    callback: Acknowledge | None = None


class Output:
    """Performs effects with `perform`. `position` is the write on which new effects depend.

    Without a disk, or when everything is on disk, effects are performed at once.
    """

    def __init__(self, disk: Disk | None, perform: Callable[[Effect, int], None], failed: Callable[[Exception], None]) -> None:
        self.position = 0
        self._disk, self._perform, self._failed = disk, perform, failed
        self._held: deque[_HeldEffect] = deque()
        if disk is not None:
            disk.listen(self._release)

    @property
    def waits(self) -> bool:
        """Whether a handled input is not on disk yet."""
        return bool(self._held) or (self._disk is not None and self.position > self._disk.durable)

    def add_effect(self, effect: Effect, number: int = 0) -> None:
        """Perform an effect, now or as soon as everything before it is on disk."""
        if self.waits:
            self._held.append(_HeldEffect(self.position, effect, number))
        else:
            self._perform(effect, number)

    def acknowledge(self, callback: Acknowledge) -> None:
        """Call back when everything handled so far is on disk and its effects are performed."""
        if self.waits:
            self._held.append(_HeldEffect(self.position, None, 0, callback))
        else:
            callback(None)

    async def on_disk(self) -> None:
        """Return when everything handled so far is on disk. Raises RemoteError when writing fails."""
        if not self.waits:
            return
        disk_write: asyncio.Future[None] = asyncio.get_running_loop().create_future()

        def settle(error: RemoteError | None) -> None:
            if disk_write.done():
                return
            if error is None:
                disk_write.set_result(None)
            else:
                disk_write.set_exception(error)

        self.acknowledge(settle)
        await disk_write

    def drop(self, error: RemoteError) -> None:
        """Discard the waiting effects, and pass the error to the waiting callbacks: the disk writes no more."""
        held, self._held = self._held, deque()
        for held_effect in held:
            if held_effect.callback is not None:
                held_effect.callback(error)

    def _release(self) -> None:
        """Perform what the disk has released, after a write or a failure."""
        assert self._disk is not None, "only a disk calls this"
        while self._held and self._held[0].position <= self._disk.durable:
            held_effect = self._held.popleft()
            try:
                if held_effect.callback is not None:
                    held_effect.callback(None)
                elif held_effect.effect is not None:
                    self._perform(held_effect.effect, held_effect.number)
            except Exception:  # a defect in one effect must not hold back those behind it
                log.exception("a %s could not be carried out", type(held_effect.effect).__name__)
        if self._disk.failed is not None:
            self._failed(self._disk.failed)

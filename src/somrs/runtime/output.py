"""What comes of a component's inputs leaves in order, and not before all that it may depend on is on disk."""

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
"""Hears that what was handled is on disk, or why it is not."""


class _HeldEffect(NamedTuple):
    """What waits until `position` is on disk: an effect with its message's number, or somebody who waits for that."""

    position: int
    effect: Effect | None
    number: int
    callback: Acknowledge | None = None


class Output:
    """Has effects carried out by `do`. `position` is what those to come depend on, as far as the disk is concerned.

    Without a disk, or when it has everything, nothing waits.
    """

    def __init__(self, disk: Disk | None, perform: Callable[[Effect, int], None], failed: Callable[[Exception], None]) -> None:
        self.position = 0
        self._disk, self._perform, self._failed = disk, perform, failed
        self._held: deque[_HeldEffect] = deque()
        if disk is not None:
            disk.listen(self._release)

    @property
    def waits(self) -> bool:
        """Whether something that was handled is not on disk yet."""
        return bool(self._held) or (self._disk is not None and self.position > self._disk.durable)

    def add_effect(self, effect: Effect, number: int = 0) -> None:
        """Have an effect carried out, now or as soon as it may be."""
        if self.waits:
            self._held.append(_HeldEffect(self.position, effect, number))
        else:
            self._perform(effect, number)

    def acknowledge(self, callback: Acknowledge) -> None:
        """Have it told when all that was handled so far is on disk, and its effects were carried out."""
        if self.waits:
            self._held.append(_HeldEffect(self.position, None, 0, callback))
        else:
            callback(None)

    async def on_disk(self) -> None:
        """Return when all that was handled so far is on disk. Raises RemoteError when it cannot be."""
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
        """Nothing more comes to be on disk. What waits for it never leaves, and who waits for it hears why."""
        held, self._held = self._held, deque()
        for held_effect in held:
            if held_effect.callback is not None:
                held_effect.callback(error)

    def _release(self) -> None:
        """The disk has written more, or has failed."""
        assert self._disk is not None, "a disk told of it"
        while self._held and self._held[0].position <= self._disk.durable:
            held_effect = self._held.popleft()
            try:
                if held_effect.callback is not None:
                    held_effect.callback(None)
                elif held_effect.effect is not None:
                    self._perform(held_effect.effect, held_effect.number)
            except Exception:  # a defect in carrying out one effect must not hold back those behind it
                log.exception("a %s could not be carried out", type(held_effect.effect).__name__)
        if self._disk.failed is not None:
            self._failed(self._disk.failed)

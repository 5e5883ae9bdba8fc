"""The lease of a component on the bus: a key with a time to live in a bucket of JetStream, which says when others should try to lead."""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import Callable
from typing import TYPE_CHECKING

from somrs.storage.nats_connection import made_with_copies

if TYPE_CHECKING:
    from nats.js import JetStreamContext
    from nats.js.kv import KeyValue

LEASE_TIME = 2.0
"""Seconds after its last renewal in which a lease ends."""

RENEWAL = 0.5
"""Seconds between two renewals of a lease, or between two attempts of a standby to get it."""

LEASES = "somrs-leaders"
"""The bucket of the leases."""


async def make_leases(js: JetStreamContext) -> None:
    """Make the bucket of the leases if there is none."""
    from nats.js.api import KeyValueConfig

    await made_with_copies(lambda copies: js.create_key_value(KeyValueConfig(bucket=LEASES, ttl=LEASE_TIME, replicas=copies)))


class Lease:
    """The lease of the component with this key. `holder`: this process, or the one before it with the same data, whose lease is its own.

    `on_lost` is called when another process has it. All methods are to be called in one event loop.
    """

    def __init__(self, bucket: KeyValue, key: str, holder: str, on_lost: Callable[[], object]) -> None:
        self._bucket, self._key, self._value, self._on_lost = bucket, key, holder.encode(), on_lost
        self._revision: int | None = None
        """The revision of the key while it is this process's."""
        self._renewing: asyncio.Task[None] | None = None
        self.ended = asyncio.Event()
        """It is renewed no more."""

    @property
    def is_held(self) -> bool:
        return self._revision is not None

    async def acquire(self) -> bool:
        """Try to get the lease, and renew it from then on."""
        from nats import errors
        from nats.js.errors import APIError

        if self._renewing is not None and not self._renewing.done():
            return True
        try:
            if not await self._take():
                return False
        except (APIError, errors.Error, OSError):
            return False
        self._renewing = asyncio.create_task(self._renew())
        return True

    async def _take(self) -> bool:
        """Get the lease if it has ended, or is this process's own. False if another process has it."""
        from nats.js.errors import KeyNotFoundError

        try:
            entry = await self._bucket.get(self._key)
        except KeyNotFoundError:
            self._revision = await self._bucket.create(self._key, self._value)
        else:
            if entry.value != self._value and _is_holder(entry.value):
                return False
            self._revision = await self._bucket.update(self._key, self._value, last=entry.revision)
        return True

    async def _renew(self) -> None:
        from nats import errors
        from nats.js.errors import APIError

        while True:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(RENEWAL):
                    await self.ended.wait()
            if self.ended.is_set():
                return
            with contextlib.suppress(APIError, errors.Error, OSError):  # the bus is away: the next attempt may find it
                if not await self._renew_once():
                    self._revision = None
                    self._on_lost()
                    return

    async def _renew_once(self) -> bool:
        """Renew the lease, or get it again if it has ended while this process or the bus stood still. False if another process has it."""
        from nats.js.errors import APIError

        try:
            self._revision = await self._bucket.update(self._key, self._value, last=self._revision)
        except APIError:
            return await self._take()
        return True

    async def resign(self) -> bool:
        """Give the lease up. Returns whether this process had it."""
        from nats import errors
        from nats.js.errors import APIError

        self.ended.set()
        if self._renewing is not None:  # not cancelled: a renewal that is under way is done, and has another revision
            await asyncio.wait([self._renewing])
        if self._revision is None:
            return False
        with contextlib.suppress(APIError, errors.Error, OSError):  # it ends by itself
            await self._bucket.delete(self._key, last=self._revision)
        return True


def _is_holder(value: bytes | None) -> bool:
    """Whether this names a process. Otherwise it is an answer of JetStream, which somebody has had sent here."""
    return value is not None and re.fullmatch(rb"[\w-]+", value) is not None

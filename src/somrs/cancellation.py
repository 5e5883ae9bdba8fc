"""Waiting that ends when it is cancelled, on every Python.

`asyncio.wait_for` of Python 3.11 loses a cancellation that comes together with the result that it waits for (CPython's gh-86296, mended in
3.12): the task goes on, and who has cancelled it waits for its end for ever. Clients of MQTT, NATS, Modbus and WebSockets wait by it, so
that any program could fail to stop.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Awaitable
from typing import TypeVar

T = TypeVar("T")


async def wait_for(awaitable: Awaitable[T], timeout: float | None) -> T:
    """Like `asyncio.wait_for` of Python 3.12: wait for a future or a coroutine, at most `timeout` seconds (None: without a limit).

    Raises TimeoutError, and asyncio.CancelledError also if the result is there when it is cancelled.
    """
    if timeout is not None and timeout <= 0:  # what has not begun does not begin
        future = asyncio.ensure_future(awaitable)
        if not future.done():
            future.cancel()
            await asyncio.wait([future])
        if future.cancelled():
            raise TimeoutError
        return future.result()
    async with asyncio.timeout(timeout):
        return await awaitable


def repair() -> None:
    """Let libraries wait by `wait_for` where Python's own loses cancellations."""
    if sys.version_info < (3, 12):
        asyncio.wait_for = wait_for  # type: ignore[assignment]  # generators have not been coroutines since 3.11

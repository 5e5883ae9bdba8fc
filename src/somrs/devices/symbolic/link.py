"""The devices' side of what is said to a symbolic world's program: a connection for each line, so that none has to be kept."""

from __future__ import annotations

import asyncio
from typing import TypeVar

from somrs.devices.symbolic.lines import LONGEST, Answer, Refused, Request, answer, written
from somrs.errors import RemoteError, UsageError

PATIENCE = 10.0
"""Seconds for which the world is waited for: its program may be starting again."""
PAUSE = 0.2
"""Seconds before it is tried once more."""

Wanted = TypeVar("Wanted", bound=Answer)


async def ask(where: str | None, request: Request, wanted: type[Wanted]) -> Wanted:
    """What the world at `host:port` answers. Raises RemoteError when it does not."""
    if where is None:
        raise UsageError(f"{request.device} is a device of a symbolic world, and this system has none; start one with `somrs up SITE`")
    host, _, port = where.rpartition(":")
    try:
        async with asyncio.timeout(PATIENCE):
            said = answer(await _line(host, int(port), written(request)))
    except TimeoutError:
        raise RemoteError(f"the symbolic world at {where} did not answer within {PATIENCE:g} s") from None
    if isinstance(said, wanted):
        return said
    raise RemoteError(said.reason if isinstance(said, Refused) else f"the symbolic world answered with {type(said).__name__}")


async def _line(host: str, port: int, said: bytes) -> bytes:
    """One line for one line. What could not be asked is asked again; what got no answer is not, for it may have been done."""
    while True:
        try:
            reader, writer = await asyncio.open_connection(host, port, limit=LONGEST)
            break
        except OSError:
            await asyncio.sleep(PAUSE)
    try:
        writer.write(said)
        line = await reader.readline()
    except (OSError, ValueError) as error:
        raise RemoteError(f"the symbolic world at {host}:{port} was lost: {error}") from None
    finally:
        writer.close()
    if not line:
        raise RemoteError(f"the symbolic world at {host}:{port} ended before it answered")
    return line

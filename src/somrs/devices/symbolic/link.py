"""The devices' side of what is said to a symbolic world's program: a connection for each line, so that none has to be kept."""

from __future__ import annotations

import asyncio
from typing import TypeVar

from somrs.devices.symbolic.lines import LONGEST, Answer, Refused, Request, encode_line, read_answer
from somrs.errors import RemoteError, UsageError

PATIENCE = 10.0
"""Seconds for which the world is waited for: its program may be starting again."""
PAUSE = 0.2
"""Seconds before it is tried once more."""

AnswerType = TypeVar("AnswerType", bound=Answer)


async def ask(address: str | None, request: Request, answer_type: type[AnswerType]) -> AnswerType:
    """What the world at `host:port` answers. Raises RemoteError when it does not."""
    if address is None:
        raise UsageError(f"{request.device} is a device of a symbolic world, and this system has none; start one with `somrs up SITE`")
    host, _, port = address.rpartition(":")
    try:
        async with asyncio.timeout(PATIENCE):
            reply = read_answer(await _line(host, int(port), encode_line(request)))
    except TimeoutError:
        raise RemoteError(f"the symbolic world at {address} did not answer within {PATIENCE:g} s") from None
    if isinstance(reply, answer_type):
        return reply
    raise RemoteError(reply.reason if isinstance(reply, Refused) else f"the symbolic world answered with {type(reply).__name__}")


async def _line(host: str, port: int, payload: bytes) -> bytes:
    """One line for one line. What could not be asked is asked again; what got no answer is not, for it may have been done."""
    while True:
        try:
            reader, writer = await asyncio.open_connection(host, port, limit=LONGEST)
            break
        except OSError:
            await asyncio.sleep(PAUSE)
    try:
        writer.write(payload)
        line = await reader.readline()
    except (OSError, ValueError) as error:
        raise RemoteError(f"the symbolic world at {host}:{port} was lost: {error}") from None
    finally:
        writer.close()
    if not line:
        raise RemoteError(f"the symbolic world at {host}:{port} ended before it answered")
    return line

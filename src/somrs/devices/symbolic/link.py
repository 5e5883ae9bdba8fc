"""The devices' side of the symbolic world's protocol. Each request has its own connection, so that none has to be kept open."""

from __future__ import annotations

import asyncio
from typing import TypeVar

from somrs.devices.link_security import SCHEME, link_credentials
from somrs.devices.symbolic.lines import LONGEST, Answer, Refused, Request, encode_line, read_answer
from somrs.errors import RemoteError, UsageError
from somrs.trust.credentials import Credentials

PATIENCE = 10.0
"""Seconds to wait for a connection to the world, whose program may be restarting.

A reply has no time limit: the connection ends with the world's program, and a busy machine is no failure.
"""
PAUSE = 0.2
"""Seconds between two attempts to connect."""

AnswerType = TypeVar("AnswerType", bound=Answer)


async def ask(address: str | None, request: Request, answer_type: type[AnswerType]) -> AnswerType:
    """Send a request to the world at `host:port`, before which is `tls://` if it has certificates, and return its reply.

    Raises RemoteError if there is none or it is a refusal.
    """
    if address is None:
        raise UsageError(f"{request.device} is a symbolic device, and this system has no symbolic world; start one with `somrs up SITE`")
    host, _, port = address.removeprefix(SCHEME).rpartition(":")
    reply = read_answer(await _line(host, int(port), encode_line(request), link_credentials(address)))
    if isinstance(reply, answer_type):
        return reply
    raise RemoteError(reply.reason if isinstance(reply, Refused) else f"the symbolic world answered with {type(reply).__name__}")


async def _line(host: str, port: int, payload: bytes, credentials: Credentials | None) -> bytes:
    """Send a line, and return the reply. A failed connection is tried again; a request without a reply is not: it may have taken effect."""
    try:
        async with asyncio.timeout(PATIENCE):
            reader, writer = await _connect(host, port, credentials)
    except TimeoutError:
        raise RemoteError(f"the symbolic world at {host}:{port} accepted no connection for {PATIENCE:g} s") from None
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


async def _connect(host: str, port: int, credentials: Credentials | None) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    while True:
        try:
            tls = credentials.client_for(f"{SCHEME}{host}") if credentials is not None else None
            return await asyncio.open_connection(host, port, limit=LONGEST, ssl=tls)
        except OSError:
            await asyncio.sleep(PAUSE)

"""What never changes, served out of memory: the many small files of a page, which NiceGUI reads and compresses anew for each browser.

NiceGUI says so itself: addresses that hold its version are `immutable` (RFC 8246). But each of its answers also sets the session's cookie,
and is said to vary with that, so that a browser asks for every file again with every page. Nothing of a file depends on who asks: what is
kept here says nothing of cookies, and browsers may keep it, too.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

FILES = "/_nicegui/"
"""Addresses below which there are only files."""

MAX_BYTES = 32 * 2**20
"""Bytes that are kept in all: a file has more addresses than one, as with `/./` in it, and somebody may try them all."""

CONDITIONS = ("range", "if-none-match", "if-modified-since", "if-match", "if-unmodified-since", "if-range")
"""Headers with which a request asks for something else than the whole file."""


@dataclass(frozen=True, slots=True)
class _Answer:
    start: Message
    body: bytes


class Cache:
    """An ASGI application before another one."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._answers: dict[tuple[str, bool], _Answer] = {}
        self._bytes_left = MAX_BYTES

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] != "GET" or scope["query_string"] or not scope["path"].startswith(FILES):
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        if any(name in headers for name in CONDITIONS):
            await self._app(scope, receive, send)
            return
        key = scope["path"], "gzip" in headers.get("accept-encoding", "")
        if (answer := self._answers.get(key)) is not None:
            await send(answer.start)
            await send({"type": "http.response.body", "body": answer.body})
            return
        messages: list[Message] = []

        async def capture(message: Message) -> None:
            if message["type"] == "http.response.start" and _is_immutable(message):
                message = _without_private_headers(message)
                messages.append(message)
            elif messages:
                messages.append(message)
            await send(message)

        await self._app(scope, _patient_receive(), capture)
        if messages and not messages[-1].get("more_body", False):
            body = b"".join(message.get("body", b"") for message in messages[1:])
            if len(body) <= self._bytes_left and key not in self._answers:
                self._answers[key] = _Answer(messages[0], body)
                self._bytes_left -= len(body)


def _patient_receive() -> Receive:
    """One who asks and does not leave: else a file would end where the first who asked for it closed the page."""
    pending_messages: list[Message] = [{"type": "http.request", "body": b"", "more_body": False}]

    async def receive() -> Message:
        return pending_messages.pop() if pending_messages else await asyncio.get_running_loop().create_future()

    return receive


def _is_immutable(start: Message) -> bool:
    return start["status"] == 200 and "immutable" in Headers(raw=start["headers"]).get("cache-control", "")


def _without_private_headers(start: Message) -> Message:
    """Without what concerns only the one who asked."""
    headers = MutableHeaders(raw=[*start["headers"]])
    del headers["set-cookie"]
    vary = [name for name in headers.get("vary", "").split(",") if name.strip() and name.strip().lower() != "cookie"]
    del headers["vary"]
    if vary:
        headers["vary"] = ", ".join(name.strip() for name in vary)
    return {**start, "headers": headers.raw}

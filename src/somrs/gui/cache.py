"""An in-memory cache for static files: a page has many small ones, which NiceGUI reads and compresses again for each browser.

NiceGUI marks addresses that contain its version as `immutable` (RFC 8246). But each response also sets the session cookie and varies by it,
so that browsers request every file again with every page. These files do not depend on the client. Cached responses therefore omit cookies,
and browsers may cache them too.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

OWN_FILES = "/files/"
FILES = ("/_nicegui/", OWN_FILES)
"""Prefixes of the addresses that serve only files."""

MAX_BYTES = 32 * 2**20
"""Limit of the cache in bytes. One file has many addresses (with `/./` in them), which a client might try out."""

CONDITIONS = ("range", "if-none-match", "if-modified-since", "if-match", "if-unmodified-since", "if-range")
"""Headers that request something other than the whole file."""


@dataclass(frozen=True, slots=True)
class _Answer:
    start: Message
    body: bytes


class Cache:
    """ASGI middleware that caches files below `FILES`."""

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
    """Return a `receive` that never disconnects: otherwise a file would be cut off when the first client closes its page."""
    pending_messages: list[Message] = [{"type": "http.request", "body": b"", "more_body": False}]

    async def receive() -> Message:
        return pending_messages.pop() if pending_messages else await asyncio.get_running_loop().create_future()

    return receive


def _is_immutable(start: Message) -> bool:
    return start["status"] == 200 and "immutable" in Headers(raw=start["headers"]).get("cache-control", "")


def _without_private_headers(start: Message) -> Message:
    """Return the message without headers that concern only one client."""
    headers = MutableHeaders(raw=[*start["headers"]])
    del headers["set-cookie"]
    vary = [name for name in headers.get("vary", "").split(",") if name.strip() and name.strip().lower() != "cookie"]
    del headers["vary"]
    if vary:
        headers["vary"] = ", ".join(name.strip() for name in vary)
    return {**start, "headers": headers.raw}

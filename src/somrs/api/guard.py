"""Who sends a request, by the secret that it comes with: the cookie of a session, or a token in the header `Authorization`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import msgspec
from msgspec.structs import replace
from starlette.datastructures import Headers
from starlette.requests import cookie_parser
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from somrs.access.auditor import Auditor
from somrs.access.identity import ANYBODY, Identity, sender
from somrs.access.rights import Right
from somrs.access.store import AccessStore
from somrs.client.refusals import Forbidden, Unauthenticated, error_report, status
from somrs.errors import SomrsError
from somrs.storage.audit_log import Actor

CHECK_PAUSE = 1.0
"""Seconds between two looks whether the sender of an open WebSocket still has access."""

SIGN_IN_HINT = (
    "say who you are: sign in with the windows in a browser; programs send the header `Authorization: Bearer TOKEN`, "
    "with a token of `somrs token new NAME`"
)

MOST_PATH = 200
"""Characters of a request that are recorded."""

POLICY_VIOLATION = 1008
"""WebSocket close code."""


class Guard:
    """ASGI middleware that lets in those who have proven who they are. The rest of the request's work finds them in `sender`.

    `store`: who has access; None: anybody has, and nobody is asked. `is_open`: whether a path is for anybody, such as that of the form to
    sign in. `refuse`: answers an HTTP request without access; None: with an error report. `auditor`: records the requests without access
    that get such a report.
    """

    def __init__(
        self,
        app: ASGIApp,
        store: AccessStore | None,
        *,
        is_open: Callable[[str], bool] = lambda path: False,
        refuse: Callable[[Scope], Response | None] = lambda scope: None,
        auditor: Auditor | None = None,
    ) -> None:
        self._app, self._store, self._is_open, self._refuse, self._auditor = app, store, is_open, refuse, auditor

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        try:
            identity = self._identity(scope)
        except SomrsError as error:
            await _deny(scope, receive, send, refusal(error))
            return
        if identity is None and not (scope["type"] == "http" and self._is_open(scope["path"])):
            response = self._refuse(scope) if scope["type"] == "http" else None
            if response is None:
                await note_denial(self._auditor, scope, "no valid secret")
            await _deny(scope, receive, send, response or refusal(Unauthenticated(SIGN_IN_HINT)))
            return
        sender.set(replace(identity, address=address_of(scope)) if identity is not None and not identity.address else identity)
        if scope["type"] == "websocket" and self._store is not None and identity is not None:
            connection = _CheckedConnection(receive, send, lambda: self._identity(scope) is not None)
            try:
                await self._app(scope, connection.receive, connection.send)
            finally:
                connection.stop_receiving()
        else:
            await self._app(scope, receive, send)

    def _identity(self, scope: Scope) -> Identity | None:
        if self._store is None:
            return ANYBODY
        secret = secret_of(scope, self._store.read().cookie)
        return self._store.identity(secret) if secret else None


ENTER, ENTER_FROM_ELSEWHERE = "enter", "enter from another site"
"""The acts of those who are not let in, which are no operations."""


def address_of(scope: Scope) -> str:
    """The address from which a request comes."""
    return scope["client"][0] if scope.get("client") else ""


async def note_denial(auditor: Auditor | None, scope: Scope, reason: str, act: str = ENTER) -> None:
    """Record a request of somebody who is not let in."""
    if auditor is not None:
        request = f"{scope.get('method', 'WebSocket')} {scope['path']}"
        await asyncio.to_thread(auditor.denied, act, Actor(name="", address=address_of(scope)), reason, {"request": request[:MOST_PATH]})


def require(required_right: Right) -> Identity:
    """Who sent the request that is worked on. Raises Unauthenticated or Forbidden if it does not have this right."""
    identity = sender.get()
    if identity is None:
        raise Unauthenticated(SIGN_IN_HINT)
    if (problem := identity.lacks(required_right)) is not None:
        raise Forbidden(problem)
    return identity


def secret_of(scope: Scope, cookie: str) -> str:
    """The secret that a request comes with; empty if it has none. A token counts before the cookie of this name."""
    headers = Headers(scope=scope)
    scheme, _, token = headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer":
        return token.strip()
    return cookie_parser("; ".join(headers.getlist("cookie"))).get(cookie, "")


def refusal(error: SomrsError, headers: dict[str, str] | None = None) -> Response:
    """An error as an HTTP response."""
    all_headers = (headers or {}) | ({"WWW-Authenticate": "Bearer"} if isinstance(error, Unauthenticated) else {})
    return Response(msgspec.json.encode(error_report(error)), status(error), all_headers, media_type="application/json")


async def _deny(scope: Scope, receive: Receive, send: Send, response: Response) -> None:
    """Answer a request, or the request for a WebSocket, by this response."""
    if scope["type"] == "http":
        await response(scope, receive, send)
        return
    await receive()
    if "websocket.http.response" in scope.get("extensions", {}):
        await response(scope, receive, send)
    else:
        await send({"type": "websocket.close", "code": POLICY_VIOLATION})


class _CheckedConnection:
    """A WebSocket that ends when its sender has no access any more."""

    def __init__(self, receive: Receive, send: Send, has_access: Callable[[], bool]) -> None:
        self._receive, self._send, self._has_access = receive, send, has_access
        self._next_message: asyncio.Task[Message] | None = None
        self._ended = False

    async def receive(self) -> Message:
        while self._is_open():
            if self._next_message is None:
                self._next_message = asyncio.ensure_future(_received(self._receive))
            arrived, _ = await asyncio.wait([self._next_message], timeout=CHECK_PAUSE)
            if arrived and self._is_open():
                message, self._next_message = self._next_message.result(), None
                return message
        await self._end()
        return {"type": "websocket.disconnect", "code": POLICY_VIOLATION}

    async def send(self, message: Message) -> None:
        if self._is_open():
            await self._send(message)
        else:
            await self._end()
            raise OSError("the connection has ended: its sender has no access any more")

    def _is_open(self) -> bool:
        return not self._ended and self._has_access()

    def stop_receiving(self) -> None:
        if self._next_message is not None:
            self._next_message.cancel()

    async def _end(self) -> None:
        self.stop_receiving()
        if not self._ended:
            self._ended = True
            await self._send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": "signed out"})


async def _received(receive: Receive) -> Message:
    return await receive()

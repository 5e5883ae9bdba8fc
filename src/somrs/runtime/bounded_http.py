"""HTTP servers that nobody can fill: uvicorn with the limits that it does not have itself.

It bounds connections, headers and bodies by number, size and time. Who exceeds a limit reads which (RFC 6585, RFC 9110) before the
connection ends. uvicorn and its parsers bound the rest: the framing of requests, and the frames of WebSockets.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Iterator, Mapping
from http import HTTPStatus
from typing import Any

import uvicorn
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol
from uvicorn.server import ServerState

from somrs.limits import Limits, limits
from somrs.trust.connections import peer_certificate

DATE_TIME = 1.0
"""Seconds between two updates of the date in the headers of responses, and two looks at the clock of each connection."""

LINGER_TIME = 5
"""Seconds for which a client that was refused may still send, so that it reads why. Nothing of it is kept."""


PEER_CERTIFICATE = "peer_certificate"
"""Where the state of a request has the certificate of its sender, as `peer_certificate` returns it; None without TLS."""


class BoundedConfig(uvicorn.Config):
    """The settings of a bounded server for an ASGI application. `body_bytes`: the size of a body, if it is not that of the limits."""

    def __init__(self, app: ASGIApp, *, bounds: Limits | None = None, body_bytes: int | None = None, **settings: Any) -> None:
        self.bounds = bounds if bounds is not None else limits()
        self.body_bytes = body_bytes if body_bytes is not None else self.bounds.body_bytes
        self.held_bytes = 0
        """The size of the bodies of all requests that are not answered."""
        quiet = {
            "log_level": "warning",
            "access_log": False,
            "timeout_graceful_shutdown": 1,
            "backlog": 512,
            "ws_max_size": self.bounds.frame_bytes,
        }
        super().__init__(_for_present_clients(app), http=BoundedProtocol, **{**quiet, **settings})


def _for_present_clients(app: ASGIApp) -> ASGIApp:
    """The application, for which it is no error that a client leaves, or is refused, before the whole request has arrived."""

    async def serve(scope: Scope, receive: Receive, send: Send) -> None:
        with contextlib.suppress(ClientDisconnect):
            await app(scope, receive, send)

    return serve


class BoundedProtocol(HttpToolsProtocol):
    """One connection."""

    def __init__(
        self,
        config: BoundedConfig,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        super().__init__(config, server_state, app_state, _loop)
        self._config, self._bounds = config, config.bounds
        self._is_refused = False
        self._in_headers, self._in_body = True, False
        self._is_served = False
        """Whether the application has been given the request that is arriving."""
        self._seconds = 0
        """For how long the connection has been in its present phase."""
        self._peer_certificate: Mapping[str, Any] | None = None
        """What the other end has proven itself with; None without TLS."""
        self._header_bytes = self._body_bytes = self._raw_bytes = self._held_bytes = 0
        self._unsent_bytes = self._unsent_seconds = 0

    @property
    def is_idle(self) -> bool:
        """Whether no request has arrived that is not answered."""
        return self._is_refused or (not self._in_body and (self.cycle is None or self.cycle.response_complete))

    @property
    def idleness(self) -> tuple[bool, int]:
        """Orders idle connections: first those that have brought no request yet."""
        return self.cycle is None, self._seconds

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._peer_certificate = peer_certificate(transport)
        if len(self.connections) <= self._bounds.connections:
            return
        siblings = (connection for connection in self.connections if isinstance(connection, BoundedProtocol) and connection is not self)
        idle = [connection for connection in siblings if connection.is_idle and not connection.transport.is_closing()]
        if idle:
            max(idle, key=lambda connection: connection.idleness).transport.abort()
        else:
            self._refuse(503, f"this server serves {self._bounds.connections} connections, which is the limit; try again later")

    def connection_lost(self, exc: Exception | None) -> None:
        self._release_bodies()
        super().connection_lost(exc)

    def tick(self) -> None:
        """Another second has passed: end what has taken too long."""
        self._seconds += 1
        unsent_bytes = self.transport.get_write_buffer_size() if self.flow.write_paused else 0
        self._unsent_seconds = self._unsent_seconds + 1 if 0 < unsent_bytes == self._unsent_bytes else 0
        self._unsent_bytes = unsent_bytes
        if self._unsent_seconds > self._bounds.send_seconds or (self._is_refused and self._seconds > LINGER_TIME):
            self.transport.abort()
        elif self._is_awaited() and self._seconds > self._bounds.request_seconds + self._body_bytes // self._bounds.bytes_per_second:
            part = "headers" if self._in_headers else "body"
            self._refuse(408, f"the {part} of the request did not arrive within {self._seconds - 1} s")

    def _is_awaited(self) -> bool:
        """Whether the client has begun a request, or its first one is to come, and the rest is waited for."""
        if self._in_headers:
            return self._header_bytes > 0 or self.cycle is None
        return self._in_body and not self.flow.read_paused

    def shutdown(self) -> None:
        if self._is_refused:
            self.transport.abort()
        else:
            super().shutdown()

    def data_received(self, data: bytes) -> None:
        if self._is_refused:
            return
        if self._in_headers:
            self._header_bytes += len(data)
        else:
            self._raw_bytes += len(data)
        super().data_received(data)
        if self._in_headers and self._header_bytes > self._bounds.header_bytes:
            self._refuse_headers()
        elif self._in_body and self._raw_bytes > 2 * self._config.body_bytes + self._bounds.header_bytes:
            self._refuse_body()  # hardly any of it is content: chunks of a byte, their extensions, trailers

    # What the parser calls

    def on_message_begin(self) -> None:
        super().on_message_begin()
        self.scope["state"][PEER_CERTIFICATE] = self._peer_certificate

    def on_header(self, name: bytes, value: bytes) -> None:
        if self._in_headers:  # and not in the trailers of a body, which mean nothing here
            super().on_header(name, value)

    def on_headers_complete(self) -> None:
        if self._is_refused:
            return
        size = len(self.url) + sum(len(name) + len(value) for name, value in self.headers)
        declared = [int(value) for name, value in self.headers if name == b"content-length"]  # the parser has checked them
        self._in_headers, self._in_body, self._seconds = False, True, 0
        if size > self._bounds.header_bytes:
            self._refuse_headers()
        elif any(length > self._config.body_bytes for length in declared):
            self._refuse_body()
        else:
            super().on_headers_complete()
            self._is_served = True

    def on_body(self, body: bytes) -> None:
        if self._is_refused:
            return
        self._body_bytes += len(body)
        self._held_bytes += len(body)
        self._config.held_bytes += len(body)
        if self._body_bytes > self._config.body_bytes:
            self._refuse_body()
        elif self._config.held_bytes > self._bounds.bodies_bytes:
            self._refuse(503, f"this server is receiving {self._bounds.bodies_bytes} bytes, which is the limit; try again later")
        else:
            super().on_body(body)

    def on_message_complete(self) -> None:
        self._in_headers, self._in_body, self._is_served, self._seconds = True, False, False, 0
        self._header_bytes = self._body_bytes = self._raw_bytes = 0
        if not self._is_refused:
            super().on_message_complete()

    def on_response_complete(self) -> None:
        if not self.pipeline:
            self._release_bodies()
        super().on_response_complete()

    def handle_websocket_upgrade(self) -> None:
        limit = self._bounds.websockets
        if sum(not isinstance(connection, BoundedProtocol) for connection in self.connections) >= limit:
            self._refuse(503, f"this server serves {limit} WebSockets, which is the limit; try again later")
        elif not self._is_refused:
            super().handle_websocket_upgrade()

    def send_400_response(self, msg: str) -> None:
        self._refuse(400, msg)

    # Refusals

    def _refuse_headers(self) -> None:
        self._refuse(431, f"the headers of the request have more than {self._bounds.header_bytes} bytes, which is the limit")

    def _refuse_body(self) -> None:
        self._refuse(413, f"the body of the request has more than {self._config.body_bytes} bytes, which is the limit")

    def _refuse(self, code: int, text: str) -> None:
        """Answer with this status, and end the connection when the client has read it; if another answer is due first, at once."""
        if self._is_refused or self.transport.is_closing():
            return
        self._is_refused, self._seconds = True, 0
        self._release_bodies()
        if self.cycle is not None and not self.cycle.response_complete:
            if not self._is_served or self.pipeline or self.cycle.response_started:
                self.transport.abort()
                return
            self.cycle.disconnected = True
            self.cycle.message_event.set()
        content = f"{text}\n".encode()
        lines = (f"HTTP/1.1 {code} {HTTPStatus(code).phrase}", "Content-Type: text/plain; charset=utf-8", f"Content-Length: {len(content)}")
        self.transport.write("\r\n".join((*lines, "Connection: close", "", "")).encode() + content)
        self.flow.resume_reading()
        if self.transport.can_write_eof():
            self.transport.write_eof()
        else:
            self.transport.close()

    def _release_bodies(self) -> None:
        self._config.held_bytes -= self._held_bytes
        self._held_bytes = 0


class QuietServer(uvicorn.Server):
    """A server that leaves signals to the program, and sleeps while there is nothing to serve: uvicorn's wakes its process ten times a
    second, to see whether it should end."""

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self._end_event = asyncio.Event()

    def end(self) -> None:
        self.should_exit = True
        self._end_event.set()

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield

    async def main_loop(self) -> None:
        while not await self.on_tick(0):
            for connection in [*self.server_state.connections]:
                if isinstance(connection, BoundedProtocol):
                    connection.tick()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(DATE_TIME):
                    await self._end_event.wait()

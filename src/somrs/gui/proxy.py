"""A proxy for `/api` at the windows' own address: it forwards requests and WebSockets of browsers to the API."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator

import aiohttp
import msgspec
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect
from yarl import URL

from somrs.client.api_client import ApiClient
from somrs.client.refusals import error_report, status
from somrs.errors import RemoteError, SomrsError
from somrs.runtime.wire import Unanswered

HOP_HEADERS = frozenset(
    ("connection", "keep-alive", "proxy-authenticate", "proxy-authorization", "te", "trailer", "transfer-encoding", "upgrade")
)
"""Hop-by-hop headers (RFC 9110, 7.6.1)."""

DROPPED_HEADERS = HOP_HEADERS | {"host", "origin", "sec-fetch-site", "cookie", "authorization", "accept-encoding"}
"""Request headers that are not forwarded: those that say which page sends, which is checked before, and the cookies of the pages; what the
sender has proven itself with is sent as a token. Without
compression, as both programs usually run on one machine."""

CHUNK_SIZE = 2**16
"""Bytes forwarded at once."""

UNAVAILABLE_CODE = 1013
"""WebSocket close code "Try again later"."""


class Proxy:
    """An ASGI application, mounted at the path of the API."""

    def __init__(self, api: ApiClient) -> None:
        self._api = api

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            await self._join_websockets(WebSocket(scope, receive, send))
        elif scope["type"] == "http":
            await (await self._forward(Request(scope, receive)))(scope, receive, send)

    def _url(self, scope: Scope) -> URL:
        path: bytes = scope.get("raw_path") or scope["path"].encode()
        rest = path.decode("latin-1").removeprefix(scope.get("root_path", ""))
        query = scope["query_string"].decode("latin-1")
        return URL(f"{self._api.url}{rest}{f'?{query}' if query else ''}", encoded=True)

    async def _forward(self, request: Request) -> Response:
        headers = [(name, value) for name, value in request.headers.items() if name not in DROPPED_HEADERS]
        headers += self._api.headers.items()
        body = await request.body()
        try:
            answer = await self._api.session.request(
                request.method,
                self._url(request.scope),
                headers=headers,
                skip_auto_headers=("Accept-Encoding", "User-Agent", "Content-Type"),
                data=body or None,
                allow_redirects=False,
            )
        except (aiohttp.ClientError, TimeoutError) as error:
            silent = Unanswered(self._api.no_answer_text(error))
            return _problem(silent, status(silent))
        response_headers = {name: value for name, value in answer.headers.items() if name.lower() not in HOP_HEADERS}

        async def chunks() -> AsyncIterator[bytes]:
            async with answer:
                async for chunk in answer.content.iter_chunked(CHUNK_SIZE):
                    yield chunk

        return StreamingResponse(chunks(), answer.status, response_headers)

    async def _join_websockets(self, browser: WebSocket) -> None:
        try:
            api = await self._api.session.ws_connect(self._url(browser.scope), headers=self._api.headers, max_msg_size=0)
        except aiohttp.WSServerHandshakeError as error:
            refusal = RemoteError(f"the API refused the WebSocket {browser.url.path}; it has /api/live and /api/poses")
            await browser.send_denial_response(_problem(refusal, error.status))
            return
        except (aiohttp.ClientError, TimeoutError):
            await browser.close(UNAVAILABLE_CODE)
            return
        async with api:
            await browser.accept()
            return_task = asyncio.create_task(_forward_to_browser(api, browser))
            try:
                await _forward_to_api(browser, api)
            finally:
                return_task.cancel()


def _problem(error: SomrsError, code: int) -> Response:
    return Response(msgspec.json.encode(error_report(error)), code, media_type="application/json")


async def _forward_to_api(browser: WebSocket, api: aiohttp.ClientWebSocketResponse) -> None:
    """Forward the browser's messages until it disconnects."""
    with contextlib.suppress(aiohttp.ClientError, ConnectionError, RuntimeError, WebSocketDisconnect):
        while (message := await browser.receive())["type"] == "websocket.receive":
            if (text := message.get("text")) is not None:
                await api.send_str(text)
            else:
                await api.send_bytes(message["bytes"])


async def _forward_to_browser(api: aiohttp.ClientWebSocketResponse, browser: WebSocket) -> None:
    """Forward the API's messages until it disconnects; then close the browser's connection. A slow browser delays the API's connection, so
    that ticks are skipped."""
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):
        while True:
            message = await api.receive()
            match message.type:
                case aiohttp.WSMsgType.BINARY:
                    await browser.send_bytes(message.data)
                case aiohttp.WSMsgType.TEXT:
                    await browser.send_text(message.data)
                case aiohttp.WSMsgType.CLOSE if message.data:
                    await browser.close(message.data, message.extra)
                    return
                case _:
                    await browser.close(UNAVAILABLE_CODE)
                    return

"""What browsers may send to a server: nothing that the page of another site has them send, or that reads this one under another name.

Any page can have a browser send requests to this computer, and with a name of its own for this computer's address (DNS rebinding) can read
the answers. Browsers say in `Host` which name was used, and in `Origin` and `Sec-Fetch-Site` which page sends (Fetch Standard; Fetch
Metadata Request Headers). Programs send no `Origin`, and are not concerned.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Collection
from urllib.parse import urlsplit

import msgspec
from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from somrs.access.auditor import Auditor
from somrs.api.guard import ENTER_FROM_ELSEWHERE, note_denial
from somrs.client.refusals import Forbidden, error_report, status

READING = frozenset(("GET", "HEAD", "OPTIONS"))
"""Methods that change nothing."""

POLICY = "; ".join(
    (
        "default-src 'self'",
        "script-src 'self' 'unsafe-inline' 'unsafe-eval'",  # the framework of the windows compiles its templates in the browser
        "style-src 'self' 'unsafe-inline'",
        "img-src 'self' data: blob:",
        "font-src 'self' data:",
        "worker-src 'self' blob:",
        "object-src 'none'",
        "base-uri 'self'",
        "form-action 'self'",
        "frame-ancestors 'none'",
    )
)
"""The Content Security Policy of all pages: nothing from elsewhere, and no page of another site around them."""

HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}
"""The headers of all responses."""


class Edge:
    """ASGI middleware that refuses what other sites have browsers send, and says in each response what its page may load.

    `allowed_hosts`: names of the server, besides IP addresses, `localhost` and the name of this computer. `auditor`: records what is
    refused.
    """

    def __init__(self, app: ASGIApp, allowed_hosts: Collection[str] = (), auditor: Auditor | None = None) -> None:
        self._app, self._auditor = app, auditor
        names = (*allowed_hosts, socket.gethostname(), "localhost")
        self._names = {name.rstrip(".").casefold() for name in names}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(scope, Headers(scope=scope))
        if refusal is None:
            await self._app(scope, receive, _with_headers(send))
            return
        await note_denial(self._auditor, scope, str(refusal), ENTER_FROM_ELSEWHERE)
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})  # before the handshake: the status is 403
            return
        response = Response(msgspec.json.encode(error_report(refusal)), status(refusal), media_type="application/json")
        await response(scope, receive, _with_headers(send))

    def _refusal(self, scope: Scope, headers: Headers) -> Forbidden | None:
        """Why a request is not served; None if it is."""
        hosts = headers.getlist("host")
        if len(hosts) != 1 or not self._is_own(hosts[0]):
            named = ", ".join(hosts) or "no host"
            return Forbidden(
                f"this server is not {named}; open the address that `somrs up` printed, or allow the name: SOMRS_ALLOWED_HOSTS"
            )
        if scope["type"] == "http" and scope["method"] in READING:
            return None
        origins, sending_site = headers.getlist("origin"), headers.get("sec-fetch-site", "same-origin")
        if not all(_is_same(origin, hosts[0]) for origin in origins):
            return Forbidden(f"a page of {', '.join(origins)} may change and follow nothing here; use the pages of this server")
        if not origins and sending_site not in ("same-origin", "none"):
            return Forbidden("a page of another site may change and follow nothing here; use the pages of this server")
        return None

    def _is_own(self, host: str) -> bool:
        """Whether a `Host` is this server: an address, which no site can have as its name, or one of the names."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        return _is_address(name) or name.rstrip(".").casefold() in self._names


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _is_same(origin: str, host: str) -> bool:
    """Whether a page comes from the server at this `Host`. A port that is not stated is that of the page's scheme."""
    try:
        page = urlsplit(origin)
        server = urlsplit(f"{page.scheme}://{host}")
        usual_port = {"http": 80, "https": 443}[page.scheme]
        return (page.hostname, page.port or usual_port) == (server.hostname, server.port or usual_port)
    except (ValueError, KeyError):
        return False


def _with_headers(send: Send) -> Send:
    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(raw=[*message["headers"]])
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
            message = {**message, "headers": headers.raw}
        await send(message)

    return send_with_headers

"""SOAP over HTTP: the server for the components of a process.

The response to a message is 202 when the component accepted it and any answer goes elsewhere, 200 with the answer when the sender waits for
it (anonymous ReplyTo), and a SOAP Fault otherwise (SOAP 1.2 part 2, 7.5.2.2). Messages in a batch are handled as if each had come alone.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Mapping

from starlette.requests import ClientDisconnect, Request
from starlette.responses import PlainTextResponse, Response
from starlette.types import Receive, Scope
from starlette.types import Send as SendPart

from somrs.errors import RemoteError, UsageError, WireError
from somrs.limits import Limits
from somrs.ports import listen_at
from somrs.protocol.component_paths import is_of_component
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.rights import check_right
from somrs.protocol.soap import soap
from somrs.protocol.soap.document import MOST_BYTES
from somrs.protocol.soap.wsdl import description, schema
from somrs.runtime import batches
from somrs.runtime.batches import Outcome
from somrs.runtime.bounded_http import PEER_CERTIFICATE, BoundedConfig, QuietServer
from somrs.runtime.neighbour_checks import check_neighbour, check_site
from somrs.runtime.places import check_addresses
from somrs.runtime.proofs import Denials, Source, proof_of
from somrs.runtime.reception import Format, Handler, Reception, unavailable
from somrs.storage.audit_log import AuditLog
from somrs.trust.credentials import Credentials
from somrs.trust.identity import Identity
from somrs.trust.neighbours import OWN_SITE

SOAP = Format(soap.encode, soap.decode, soap.fault)

KEPT_TIME = 60
"""Seconds for which a client keeps an idle connection. The server keeps it longer, so that it never closes a connection first."""

CONTENT_TYPE = f"{soap.MEDIA_TYPE}; charset=utf-8"
_HANG_UP = {"Connection": "close"}
_ACCEPTED = Response(status_code=202)
_STARTING = "no component is available yet; this process is starting"


class Server:
    """Serves `parts`, the handlers by path, at one port. Runs in the present event loop.

    `public_url`: how others reach it, if that is not its own host and port. `bounds`: by default those of the environment. `credentials`:
    with them, it speaks HTTPS only, with who has a certificate of the same authority or of a neighbour's, and checks the rights of the
    sender of each message.
    """

    def __init__(
        self,
        host: str,
        port: int,
        parts: Mapping[str, Handler] | None = None,
        public_url: str | None = None,
        bounds: Limits | None = None,
        credentials: Credentials | None = None,
    ) -> None:
        self.host, self.port, self._public_url, self._bounds = host, port, public_url, bounds
        self._credentials = credentials
        self.parts: Mapping[str, Handler] = parts if parts is not None else {}
        self._serving: asyncio.Task[None] | None = None
        self._server: QuietServer | None = None
        data = credentials.data if credentials is not None else None
        self._reception = Reception(SOAP, self.parts, Denials(AuditLog(data) if data is not None else None, _message_check(credentials)))

    @property
    def url(self) -> str:
        return f"{'http' if self._credentials is None else 'https'}://{self.host}:{self.port}"

    @property
    def open_count(self) -> int:
        """How many requests are open."""
        return self._reception.open_count

    async def start(self) -> None:
        """Listen. Port 0 becomes a free port. Raises UsageError when the port is not available."""
        server_socket = listen_at(self.host, self.port)
        self.port = server_socket.getsockname()[1]
        config = BoundedConfig(
            self._serve,
            bounds=self._bounds,
            body_bytes=MOST_BYTES,
            interface="asgi3",
            lifespan="off",
            ws="none",
            timeout_keep_alive=KEPT_TIME + 15,
            proxy_headers=False,
            headers=[("Accept-Post", batches.ACCEPTED)],
            ssl_context_factory=(lambda *_: credentials.entrance) if (credentials := self._credentials) is not None else None,
        )
        self._server = QuietServer(config)
        self._serving = asyncio.create_task(self._server.serve(sockets=[server_socket]))
        while not self._server.started:
            if self._serving.done():
                raise UsageError(f"cannot listen at {self.url}")
            await asyncio.sleep(0.005)

    async def stop(self) -> None:
        """Stop listening. Requests that wait for an answer get a Fault; requests that are still being read get the status 503."""
        if self._server is not None and self._serving is not None:
            self._server.end()
            self._reception.stop()
            with contextlib.suppress(asyncio.CancelledError):
                await self._serving

    async def _serve(self, scope: Scope, receive: Receive, send: SendPart) -> None:
        """Serve one ASGI request. The method is the only routing: every message comes this way, and needs no more."""
        match scope["method"]:
            case _ if not self.parts:
                # A process listens before its components are read from disk; clients that know their addresses have to try again.
                response = _response(unavailable(RemoteError(_STARTING)))
            case "POST":
                response = await self._handle_post(scope, receive)
            case "GET" | "HEAD":
                response = await self._handle_get(Request(scope))
            case _:
                response = PlainTextResponse("send messages with POST\n", 405, headers={"Allow": "GET, HEAD, POST"})
        await response(scope, receive, send)

    async def _handle_post(self, scope: Scope, receive: Receive) -> Response:
        handler = self.parts.get(scope["path"])
        if handler is None:
            return PlainTextResponse(self._reception.not_found_text(scope["path"]), 404)
        headers: dict[bytes, bytes] = dict(scope["headers"])
        content_type = headers.get(b"content-type", b"").decode("latin-1")
        is_batch = content_type == batches.MEDIA_TYPE
        if not (is_batch or _is_soap(content_type)) or not _is_plain(headers):
            return PlainTextResponse(f"send {CONTENT_TYPE}, not compressed\n", 415, headers=_HANG_UP)
        try:
            self._reception.check_open()
            document = await self._reception.unless_stopped(_body(receive))
        except ClientDisconnect:
            return Response(status_code=400)
        except RemoteError as error:
            return _response(unavailable(error))
        source = self._source(scope)
        return await self._take_batch(document, source) if is_batch else _response(await self._reception.outcome(document, handler, source))

    def _source(self, scope: Scope) -> Source:
        """Where a request comes from. Who is proven to send it is checked for each of its messages."""
        host: str = scope["client"][0] if scope["client"] else ""
        if self._credentials is None:
            return Source(host)
        return Source(host, proof_of(self._credentials, scope["state"][PEER_CERTIFICATE]))

    async def _take_batch(self, batch: bytes, source: Source) -> Response:
        """Handle the messages of a batch in order, each at the component to which it is addressed."""
        try:
            documents = batches.documents_of(batch)
        except ValueError as error:
            return PlainTextResponse(f"this is not a batch of messages: {error}\n", 400)
        outcomes = await self._reception.outcomes(documents, source)
        return Response(batches.answer(outcomes), media_type=batches.MEDIA_TYPE)

    async def _handle_get(self, request: Request) -> Response:
        path = request.url.path
        if path not in self.parts:
            return PlainTextResponse(self._reception.not_found_text(path), 404)
        query = request.query_params
        if "wsdl" in query:
            # Not at the address that the request names, which may be anybody's choice.
            return _xml(description(path, f"{self._public_url or self.url}{path}"))
        if (schema_name := query.get("xsd")) is not None:
            return _xml(schema(schema_name))
        return PlainTextResponse(f"a SOAP 1.2 endpoint of SO-MRS; its description is at {path}?wsdl\n")


def _message_check(credentials: Credentials | None) -> Callable[[Message, Identity], None]:
    """The check of a message to who has these credentials: that its sender may send it, and with these addresses.

    It raises WireError with the code `DENIED`.
    """

    def check(message: Message, identity: Identity) -> None:
        assert credentials is not None, "who has none, checks nobody"
        if identity.site != OWN_SITE:
            check_neighbour(message, identity, credentials)
            return
        check_right(message, identity)
        check_addresses(message, identity, is_of_component)
        check_site(message, credentials)

    return check


def _response(outcome: Outcome) -> Response:
    status, content = outcome
    if status == 202:
        return _ACCEPTED
    if status == 503:
        # A Fault, for senders that show people nothing else. It is no answer: the message is to be sent again.
        fault = soap.fault(WireError(soap.RECEIVER, content.decode().strip()))
        return Response(fault, status, media_type=CONTENT_TYPE, headers=_HANG_UP)
    return Response(content, status, media_type=CONTENT_TYPE)


def _xml(document: bytes | None) -> Response:
    return Response(document, media_type="text/xml") if document is not None else PlainTextResponse("there is no such document\n", 404)


def _is_soap(content_type: str) -> bool:
    media, _, parameters = content_type.partition(";")
    charset = parameters.lower().partition("charset=")[2].partition(";")[0].strip(' "')
    return media.strip().lower() == soap.MEDIA_TYPE and charset in ("", "utf-8", "utf-16")


def _is_plain(headers: dict[bytes, bytes]) -> bool:
    return headers.get(b"content-encoding", b"").strip().lower() in (b"", b"identity")


async def _body(receive: Receive) -> bytes:
    """Return the request's body, whose size and time the server bounds."""
    body, is_incomplete = b"", True
    while is_incomplete:
        part = await receive()
        if part["type"] == "http.disconnect":
            raise ClientDisconnect
        body += part.get("body", b"")
        is_incomplete = part.get("more_body", False)
    return body

"""The service of a site's authority (`somrs run trust`): there, programs on other computers enrol, renew their certificates, and read what
is revoked, here and at neighbours.

To enrol, the word of an invitation is needed. What is revoked here, anybody may read, so that neighbours know. Everything else is for who
has a certificate of the site that holds. Where a program is reached, its certificate says only if the invitation does, or if it is the
computer from which the request came: otherwise a device could get a certificate for the address of another program, and answer in its
place.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
import ssl
import time
from collections.abc import Awaitable, Callable
from datetime import UTC, datetime
from ipaddress import ip_address
from pathlib import Path
from urllib.parse import urlsplit

import msgspec
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from somrs.client.addresses import SYSTEM_FILE
from somrs.deployment.programs import until_stopped
from somrs.errors import UsageError
from somrs.ports import check_address, listen_at
from somrs.runtime.bounded_http import PEER_CERTIFICATE, BoundedConfig, QuietServer
from somrs.runtime.http import KEPT_TIME
from somrs.runtime.revocations import Revocations
from somrs.runtime.trust_client import (
    AUTHORITY_PATH,
    ENROL_PATH,
    NEWS_PATH,
    RENEW_PATH,
    REVOKED_PATH,
    Enrolled,
    EnrolRequest,
    RenewRequest,
)
from somrs.storage.audit_log import Actor, AuditLog
from somrs.storage.denial_counts import DenialCounts
from somrs.trust.authority import Authority
from somrs.trust.connections import peer_of
from somrs.trust.credentials import SERVICE_FILE, Credentials
from somrs.trust.files import write_private
from somrs.trust.holders import TrustNews, write_revoked
from somrs.trust.identity import Identity, Role

log = logging.getLogger(__name__)

NEWS_TIME = 25.0
"""Seconds after which who waits for news is told that there are none."""

LOOK_PAUSE = 0.2
"""Seconds between two looks for news."""

OWN_LOOK_PAUSE = 600.0
"""Seconds between two looks whether the own certificate is due for renewal."""

MOST_BYTES = 65_536
"""The maximum size of a request."""

NAME = "trust"
"""The name of this program's certificate."""

Answer = Callable[[Request], Awaitable[Response]]


async def run_trust(data: Path, host: str, port: int, url: str | None = None) -> None:
    """Run the service until this process is asked to stop. `url`: how other computers reach it, if it is not at its host and port.

    Raises UsageError when there is no authority, the host is no address, or the port is not available.
    """
    authority = Authority.of_data(data)
    if url is None:
        check_address(host)
    server_socket = listen_at(host, port)
    url = (url or f"https://{host}:{server_socket.getsockname()[1]}").rstrip("/")
    own = _Own(authority, host, urlsplit(url).hostname or host)
    service = TrustService(authority, own.credentials)
    server = QuietServer(
        BoundedConfig(
            service.application,
            body_bytes=MOST_BYTES,
            lifespan="off",
            ws="none",
            timeout_keep_alive=KEPT_TIME + 15,
            ssl_context_factory=lambda *_: _with_strangers(own.credentials.entrance),
        )
    )
    serving = asyncio.create_task(server.serve(sockets=[server_socket]))
    while not server.started and not serving.done():
        await asyncio.sleep(0.01)
    write_private(authority.folder / SERVICE_FILE, f"{url}\n".encode())
    renewing, following = asyncio.create_task(own.renew()), asyncio.create_task(Revocations(own.credentials).follow())
    try:
        await until_stopped("trust", url)
    finally:
        renewing.cancel()
        following.cancel()
        service.stop()
        server.end()
        await serving


def _with_strangers(context: ssl.SSLContext) -> ssl.SSLContext:
    """Who enrols has no certificate yet."""
    context.verify_mode = ssl.CERT_OPTIONAL
    return context


class _Own:
    """The service's own certificate."""

    def __init__(self, authority: Authority, *hosts: str) -> None:
        self._authority, self._hosts = authority, tuple(dict.fromkeys((*hosts, "127.0.0.1", "localhost")))
        self.credentials = Credentials(self._issue())

    def _issue(self) -> Path:
        identity = Identity(name=NAME, roles=frozenset({Role.VIEWER}))
        return self._authority.issue_program(identity, self._hosts, datetime.now(UTC))[0]

    async def renew(self) -> None:
        """Renew it when it is due, until cancelled."""
        while True:
            await asyncio.sleep(OWN_LOOK_PAUSE)
            try:
                await asyncio.to_thread(self._issue)
                self.credentials.renew()
            except (OSError, UsageError) as error:  # such as a full disk, which may have room again
                log.warning("the certificate of this program is not renewed: %s; that is tried again", error)


class TrustService:
    """The answers of the service. `credentials`: its own, by which it also knows what is revoked."""

    def __init__(self, authority: Authority, credentials: Credentials) -> None:
        self._authority, self._credentials = authority, credentials
        self._audit_log = AuditLog(authority.folder.parent)
        self._denials = DenialCounts()
        self._is_stopping = False
        self.application = Starlette(
            routes=[
                Route(AUTHORITY_PATH, self._send_authority),
                Route(REVOKED_PATH, self._send_revoked),
                Route(ENROL_PATH, self._explained(self._enrol), methods=["POST"]),
                Route(RENEW_PATH, self._explained(self._renew), methods=["POST"]),
                Route(NEWS_PATH, self._explained(self._send_news)),
            ]
        )

    def stop(self) -> None:
        """Let nobody wait for news any more."""
        self._is_stopping = True

    def _explained(self, answer: Answer) -> Answer:
        async def explained(request: Request) -> Response:
            try:
                return await answer(request)
            except UsageError as error:
                await self._note_denial(request, str(error))
                return PlainTextResponse(f"{error}\n", 403)
            except msgspec.DecodeError as error:
                return PlainTextResponse(f"the request cannot be read: {error}\n", 400)

        return explained

    async def _note_denial(self, request: Request, text: str) -> None:
        """Record who was refused. Anybody can ask, so not each time."""
        address = _address(request)
        if (count := self._denials.add(address)) is not None:
            act, actor, details = f"trust.{request.url.path.strip('/')}", Actor(name="", address=address), {"why": text, "times": count}
            await asyncio.to_thread(self._audit_log.append, act, "denied", actor, details)

    async def _send_authority(self, request: Request) -> Response:
        return Response(self._authority.certificate_file.read_bytes(), media_type="application/x-pem-file")

    async def _send_revoked(self, request: Request) -> Response:
        return PlainTextResponse(write_revoked(self._credentials.revoked))

    async def _enrol(self, request: Request) -> Response:
        question = msgspec.json.decode(await request.body(), type=EnrolRequest)
        address = _address(request)
        hosts = ("127.0.0.1", "localhost") if ip_address(address).is_loopback else (address,)
        now = datetime.now(UTC)
        certificate = await asyncio.to_thread(self._authority.enrol, question.word, question.request.encode(), hosts, now)
        return await self._enrolled("trust.enrol", certificate, now, address)

    async def _renew(self, request: Request) -> Response:
        serial = self._proven_serial(request)
        question, now = msgspec.json.decode(await request.body(), type=RenewRequest), datetime.now(UTC)
        certificate = await asyncio.to_thread(lambda: self._authority.renew_serial(serial, question.request.encode(), now, is_due=True))
        return await self._enrolled("trust.renew", certificate, now, _address(request))

    async def _enrolled(self, act: str, certificate: bytes, now: datetime, address: str) -> Response:
        name = self._authority.check(certificate, now).name
        await asyncio.to_thread(self._audit_log.append, act, "done", Actor(name=name, address=address))
        return _json(Enrolled(name=name, certificate=certificate.decode(), news=self._news()))

    async def _send_news(self, request: Request) -> Response:
        self._proven_serial(request)
        end, version = time.monotonic() + NEWS_TIME, request.query_params.get("after", "")
        while (news := self._news()).version == version and time.monotonic() < end and not self._is_stopping:
            await asyncio.sleep(LOOK_PAUSE)
            self._proven_serial(request)  # it may be the one that has been revoked
        return _json(news)

    def _news(self) -> TrustNews:
        revoked, holders = tuple(sorted(self._credentials.revoked)), self._credentials.holders
        try:
            system = msgspec.json.decode((self._authority.folder.parent / SYSTEM_FILE).read_bytes(), type=dict[str, object])
            system.pop("trust", None)  # a folder of this computer
        except (OSError, msgspec.DecodeError):
            system = None
        neighbours, of_neighbours = self._credentials.neighbours.all, self._credentials.revoked_of_neighbours
        document = msgspec.json.encode((revoked, holders, system, neighbours, of_neighbours), order="deterministic")
        return TrustNews(
            version=hashlib.sha256(document).hexdigest()[:32],
            revoked=revoked,
            holders=holders,
            system=system,
            neighbours=neighbours,
            revoked_of_neighbours=of_neighbours,
        )

    def _proven_serial(self, request: Request) -> str:
        """The serial number of the certificate of who asks. Raises UsageError if it has none that holds."""
        certificate = request.scope["state"][PEER_CERTIFICATE]
        if not certificate:
            raise UsageError("this is for who has a certificate of the site: enrol with the word of an invitation")
        peer = peer_of(certificate)
        self._credentials.check(peer, time.time())
        return peer.serial


def _json(answer: msgspec.Struct) -> Response:
    return Response(msgspec.json.encode(answer), media_type="application/json")


def _address(request: Request) -> str:
    return request.client.host if request.client is not None else ""

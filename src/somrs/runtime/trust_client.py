"""What programs do with the service of their site's authority, on another computer: enrol, know what is revoked, renew their certificate.

`follow` does the latter two for as long as a program runs. It replaces the files beside its certificate, which everybody reads again when
they have been replaced (`trust/credentials.py`).
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import logging
import ssl
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import aiohttp
import msgspec

from somrs.errors import RemoteError, UsageError
from somrs.kernel.durability import FIRST_PAUSE, LONGEST_PAUSE
from somrs.runtime.wire import tls_error
from somrs.trust.connections import fingerprint
from somrs.trust.credentials import SERVICE_FILE, Credentials, advice
from somrs.trust.files import install, write_private
from somrs.trust.holders import TrustNews

log = logging.getLogger(__name__)

ANSWER_TIME = 90.0
"""Seconds after which the service is asked again. It answers within half a minute, with news or without."""

MOST_BYTES = 16_000_000
"""The maximum size of an answer."""

AUTHORITY_PATH, ENROL_PATH, RENEW_PATH, NEWS_PATH = "/authority.pem", "/enrol", "/renew", "/news"
REVOKED_PATH = "/revoked"


class EnrolRequest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Asks for the certificate to which a word invites. `request`: PKCS #10, in PEM."""

    word: str
    request: str


class RenewRequest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Asks for a certificate to follow the one of this connection."""

    request: str


class Enrolled(msgspec.Struct, frozen=True, kw_only=True):
    """The certificate, in PEM, and the name of who has it."""

    name: str
    certificate: str
    news: TrustNews


async def enrol_at(url: str, word: str, folder: Path) -> list[Path]:
    """Enrol at the service with this URL: make a key, get the certificate to which the word invites, and write the files into a folder.

    Raises UsageError when it is refused, or when the service is not that of the authority that has invited, and RemoteError when it cannot
    be reached.
    """
    from somrs.trust import certificates
    from somrs.trust.enrolment import write_files

    url = url.rstrip("/")
    authority = await _authority_of(url, word)
    context = ssl.create_default_context(cadata=authority)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    request = certificates.make_request()
    async with aiohttp.ClientSession(connector=aiohttp.TCPConnector(ssl=context)) as session:
        question = EnrolRequest(word=word, request=request.certificate.decode())
        answer = msgspec.json.decode(await _ask(session, "POST", url + ENROL_PATH, msgspec.json.encode(question)), type=Enrolled)
    beside = {"authority.pem": authority.encode(), SERVICE_FILE: f"{url}\n".encode()} | answer.news.files
    return write_files(folder, answer.name, answer.certificate.encode(), request.key, beside)


async def _authority_of(url: str, word: str) -> str:
    """The certificate of the authority that has invited, in PEM. It is read from anybody who answers, and known by the word."""
    expected = word.strip().partition(".")[2]
    if not expected:
        raise UsageError("this is not a whole word of an invitation: it has two parts with a dot between")
    async with aiohttp.ClientSession(connector=aiohttp.TCPConnector(ssl=False)) as session:
        answer = await _ask(session, "GET", url + AUTHORITY_PATH)
    try:
        authority = answer.decode()
        if fingerprint(authority) == expected:
            return authority
    except ValueError:  # it is no certificate
        pass
    raise UsageError(f"{url} is not the service of the authority that has invited: check the address, and that nobody is in between")


async def _ask(session: aiohttp.ClientSession, method: str, url: str, body: bytes | None = None) -> bytes:
    """The answer of the service. Raises UsageError with its text when it refuses, and RemoteError when it cannot be reached."""
    try:
        timeout = aiohttp.ClientTimeout(total=ANSWER_TIME)
        async with session.request(method, url, data=body, timeout=timeout, allow_redirects=False) as response:
            content = b""
            while len(content) <= MOST_BYTES and (chunk := await response.content.read(MOST_BYTES)):
                content += chunk
    except TimeoutError:
        raise RemoteError(f"{url} did not answer within {ANSWER_TIME:g} s") from None
    except aiohttp.InvalidURL as error:
        raise UsageError(f"{url} is no address: {error}") from None
    except aiohttp.ClientError as error:
        cause = tls_error(error)
        raise RemoteError(f"{url} cannot be reached: {advice(cause) if cause is not None else error}") from None
    if response.status == 200:
        return content
    text = content[:500].decode(errors="replace").strip()
    if 400 <= response.status < 500 and response.status not in (408, 429):
        raise UsageError(text or f"{url} answered with HTTP {response.status}")
    raise RemoteError(f"{url} answered with HTTP {response.status}: {text}")


@asynccontextmanager
async def following(credentials: Credentials | None) -> AsyncIterator[None]:
    """Follow the service of the authority, if these credentials have one elsewhere."""
    if credentials is None or credentials.service is None:
        yield
        return
    task = asyncio.create_task(follow(credentials, credentials.service))
    try:
        yield
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


async def follow(credentials: Credentials, url: str) -> None:
    """Know what is revoked and who holds a certificate, and renew the own one when it is due, until cancelled.

    While the service cannot be reached, what was read last counts, and the log says so once.
    """
    version, pause, is_lost = "", FIRST_PAUSE, False
    while True:
        try:
            async with aiohttp.ClientSession(connector=aiohttp.TCPConnector(ssl=credentials.client)) as session:
                generation = credentials.generation
                while generation == credentials.generation:  # new connections show the new certificate
                    version = await _read_news(session, credentials, url, version)
                    await _renew_if_due(session, credentials, url)
                    if is_lost:
                        log.warning("the authority at %s is reached again", url)
                    pause, is_lost = FIRST_PAUSE, False
        except (RemoteError, UsageError, msgspec.DecodeError, OSError) as error:
            if not is_lost:
                log.warning("the authority at %s does not help: %s; what it has said last counts", url, error)
            is_lost = True
        await asyncio.sleep(pause)
        pause = min(pause * 2, LONGEST_PAUSE)


async def _read_news(session: aiohttp.ClientSession, credentials: Credentials, url: str, version: str) -> str:
    """Write down what is new since this version, as soon as there is something, and return the version of it."""
    news = msgspec.json.decode(await _ask(session, "GET", f"{url}{NEWS_PATH}?after={version}"), type=TrustNews)
    if news.version != version:
        for name, content in news.files.items():
            file = credentials.folder / name
            if not file.exists() or file.read_bytes() != content:
                write_private(file, content)
    return news.version


async def _renew_if_due(session: aiohttp.ClientSession, credentials: Credentials, url: str) -> None:
    """Get a new certificate if two thirds of the time of the own one are over. Several programs that share one do it one at a time."""
    if not credentials.is_renewal_due(time.time()):
        return
    from somrs.trust import certificates

    with credentials.certificate.with_suffix(".lock").open("a") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return
        if not credentials.is_renewal_due(time.time()):
            return
        request = await asyncio.to_thread(certificates.make_request)
        question = RenewRequest(request=request.certificate.decode())
        answer = msgspec.json.decode(await _ask(session, "POST", url + RENEW_PATH, msgspec.json.encode(question)), type=Enrolled)
        for name, content in answer.news.files.items():
            write_private(credentials.folder / name, content)
        install(credentials.certificate, answer.certificate.encode(), request.key)
    credentials.renew()
    log.warning("the certificate of %s is renewed", credentials.name)

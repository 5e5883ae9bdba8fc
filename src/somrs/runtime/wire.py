"""The client side of SOAP over HTTP: sends messages to the components of other processes. `http.py` is the server side."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import ssl
from collections.abc import Awaitable, Callable, Sequence
from datetime import UTC, datetime
from typing import NamedTuple, TypeVar

import aiohttp

from somrs.errors import RemoteError, WireError
from somrs.kernel.durability import FIRST_PAUSE, LONGEST_PAUSE
from somrs.protocol.messages.bodies import REQUESTS
from somrs.protocol.messages.envelope import ANONYMOUS, Message
from somrs.protocol.messages.frp import Fault
from somrs.protocol.soap import soap
from somrs.protocol.soap.document import MOST_BYTES
from somrs.runtime import batches
from somrs.runtime.batches import Outcome
from somrs.runtime.http import CONTENT_TYPE, KEPT_TIME
from somrs.runtime.neighbour_checks import check_answer
from somrs.trust.credentials import Credentials, advice

log = logging.getLogger(__name__)

T = TypeVar("T")

REMINDER = 60.0
"""Seconds after which who waits for an answer says so in the log, again and again."""

Encode = Callable[[Message], bytes]
"""Writes a message. Raises WireError."""

Decode = Callable[[bytes], Message]
"""Reads an answer. Raises WireError."""

NONE_ADDRESS = "http://www.w3.org/2005/08/addressing/none"
"""WS-Addressing 1.0 Core, 2.1: messages to this address are discarded."""

UNTAKEN = (408, 503)
"""HTTP statuses of requests that came to nothing, and may be sent again."""

_OMITTED_HEADERS = ("Accept", "Accept-Encoding", "User-Agent")
"""Headers that aiohttp would add: they accept any answer, also a compressed one, which is not read here."""


class Unanswered(RemoteError):
    """The recipient was not available, or ended before it answered. It is safe to send the same message again."""


async def retry_unanswered(ask: Callable[[], Awaitable[T]], patience: float) -> T:
    """Call `ask` again while there is no answer, for `patience` seconds from the first failure. Raises Unanswered after that.

    Who has to wait for long reads in the log for whom, every `REMINDER` seconds.
    """
    loop = asyncio.get_running_loop()
    failed_at, reminded_at, pause = None, 0.0, FIRST_PAUSE
    while True:
        try:
            return await ask()
        except Unanswered as error:
            now = loop.time()
            if failed_at is None:  # a recipient that is slow to answer has used up no patience yet
                failed_at = reminded_at = now
            if now + pause > failed_at + patience:
                raise
            if now >= reminded_at + REMINDER:
                reminded_at = now
                log.warning("%s; it is asked again until it answers", error)
        await asyncio.sleep(pause)
        pause = min(pause * 2, LONGEST_PAUSE)


def origin(address: str) -> str:
    """Return scheme, host and port of an address: all components behind them are in one process."""
    return "/".join(address.split("/", 3)[:3])


class _Response(NamedTuple):
    """The response to a request."""

    status: int
    media_type: str
    document: bytes


class Wire:
    """Sends messages to components in other processes, over persistent connections. `credentials`: those for HTTPS."""

    def __init__(self, credentials: Credentials | None = None) -> None:
        self._credentials = credentials
        self._session: aiohttp.ClientSession | None = None
        self._batching: set[str] = set()

    def destination(self, address: str) -> str | None:
        """The process at the address, if its last response announced that it accepts batches."""
        return process if (process := origin(address)) in self._batching else None

    async def post(self, message: Message, timeout: float = 30.0) -> Message | None:
        """Send the message. Return the answer on the same connection, or None when the message was accepted without one.

        A Fault that answers a request is an answer; a Fault because the message could not be processed is an error.

        Raises:
            Unanswered: there was no answer; the message may be sent again.
            RemoteError: the message was rejected.
        """
        if message.header.recipient == NONE_ADDRESS:
            return None
        return self._checked(
            _read(await self._send_alone(message, write_document(message, soap.encode), timeout), message, soap.decode), message
        )

    async def post_separately(self, messages: Sequence[Message], timeout: float) -> list[Message | None]:
        """Send the first message: the process may not accept batches."""
        return [await self.post(messages[0], timeout)]

    async def post_batch(self, messages: Sequence[Message], timeout: float) -> list[Message | RemoteError | None]:
        """Send the first messages to the process of their recipients, as many as fit in one request.

        Return for each the answer, None, or the error for which it was rejected. Raises Unanswered when the process is not available.
        """
        try:
            documents = batch_documents(messages, soap.encode)
        except RemoteError as error:
            return [error]
        sent_messages = messages[: len(documents)]
        if len(sent_messages) == 1:
            response = await self._send_alone(sent_messages[0], documents[0], timeout)
            return self._all_checked([_result(response, sent_messages[0], soap.decode)], sent_messages)
        response = await self._send(sent_messages[0].header.recipient, batches.MEDIA_TYPE, batches.batch(documents), timeout)
        if response.media_type == batches.MEDIA_TYPE:
            outcomes = batches.outcomes_of(response.document)
            if len(outcomes) == len(sent_messages):
                return self._all_checked(read_outcomes(outcomes, sent_messages, soap.decode), sent_messages)
        refused = _unexpected(response, sent_messages[0])
        if isinstance(refused, Unanswered):
            raise refused
        return [refused] * len(sent_messages)

    def _checked(self, answer: Message | None, request: Message) -> Message | None:
        """An answer that who gave it has the right to. Raises RemoteError if it has not."""
        if answer is not None and self._credentials is not None:
            check_answer(answer, request, self._credentials)
        return answer

    def _all_checked(
        self, outcomes: Sequence[Message | RemoteError | None], requests: Sequence[Message]
    ) -> list[Message | RemoteError | None]:
        """The outcomes of requests, with errors in place of answers that were not for their sender to give."""
        checked: list[Message | RemoteError | None] = []
        for outcome, request in zip(outcomes, requests, strict=True):
            try:
                checked.append(outcome if isinstance(outcome, RemoteError) else self._checked(outcome, request))
            except RemoteError as error:
                checked.append(error)
        return checked

    async def _send_alone(self, message: Message, document: bytes, timeout: float) -> _Response:
        kind = f'{CONTENT_TYPE}; action="{soap.action(type(message.body))}"'
        return await self._send(message.header.recipient, kind, document, timeout)

    async def _send(self, address: str, content_type: str, document: bytes, timeout: float) -> _Response:
        tls: ssl.SSLContext | bool = True
        if self._credentials is not None:
            self._credentials.renew()
            tls = self._credentials.client_for(address)
        if self._session is None:
            connector = aiohttp.TCPConnector(limit=0, keepalive_timeout=KEPT_TIME)
            self._session = aiohttp.ClientSession(
                connector=connector, cookie_jar=aiohttp.DummyCookieJar(), auto_decompress=False, skip_auto_headers=_OMITTED_HEADERS
            )
        try:
            async with self._session.post(
                address,
                data=document,
                headers={"Content-Type": content_type},
                timeout=aiohttp.ClientTimeout(total=timeout),
                allow_redirects=False,
                ssl=tls,
            ) as response:
                content = await response.content.read(MOST_BYTES + 1)
                while len(content) <= MOST_BYTES and (chunk := await response.content.read(MOST_BYTES + 1 - len(content))):
                    content += chunk
        except TimeoutError:
            raise Unanswered(f"{address} did not answer within {timeout:g} s") from None
        except aiohttp.ClientError as error:
            raise Unanswered(f"{address} cannot be reached: {self._connection_problem(error)}") from None
        except ValueError as error:
            raise RemoteError(f"{address} cannot be reached: {error}") from None
        accepts_batches = batches.MEDIA_TYPE in response.headers.get("Accept-Post", "")
        (self._batching.add if accepts_batches else self._batching.discard)(origin(address))
        return _Response(response.status, response.content_type, content)

    def _connection_problem(self, error: aiohttp.ClientError) -> str:
        """Why there is no connection, for people."""
        if (cause := tls_error(error)) is not None:
            return advice(cause)
        if self._credentials is not None and (own_problem := self._credentials.own_problem(datetime.now(UTC))):
            return own_problem
        if isinstance(error, aiohttp.ClientConnectorError):
            return error.os_error.strerror or "no connection"
        return str(error)

    async def close(self) -> None:
        if self._session is not None:
            await self._session.close()
            self._session = None


def tls_error(error: BaseException | None) -> ssl.SSLError | None:
    """The error of TLS from which another one comes, if there is one."""
    while error is not None:
        for cause in (getattr(error, "certificate_error", None), getattr(error, "os_error", None), error):
            if isinstance(cause, ssl.SSLError) and not isinstance(cause, aiohttp.ClientError):
                return cause
        error = error.__cause__ or error.__context__
    return None


def batch_documents(messages: Sequence[Message], encode: Encode) -> list[bytes]:
    """The documents of the first messages, as many as fit in one request. Raises RemoteError when the first message cannot be sent."""
    documents: list[bytes] = []
    try:
        for document in batches.fit_batch(write_document(message, encode) for message in messages):
            documents.append(document)  # the messages before one that cannot be sent are sent
    except RemoteError:
        if not documents:
            raise
    return documents


def write_document(message: Message, encode: Encode) -> bytes:
    """The document of a message. Raises RemoteError when it cannot be sent."""
    if message.header.recipient == ANONYMOUS:
        raise RemoteError(f"no connection waits for this {type(message.body).__name__}: its recipient is anonymous")
    try:
        return encode(message)
    except WireError as error:
        raise RemoteError(f"{type(message.body).__name__} cannot be sent to {message.header.recipient}: {error.text}") from None


def read_outcomes(outcomes: Sequence[Outcome], messages: Sequence[Message], decode: Decode) -> list[Message | RemoteError | None]:
    """What the outcomes of a batch say of each message: the answer, None, or the error for which it was rejected."""
    responses = (_Response(status, "text/plain" if status in (404, 503) else soap.MEDIA_TYPE, document) for status, document in outcomes)
    return [_result(response, message, decode) for response, message in zip(responses, messages, strict=True)]


def _result(response: _Response, message: Message, decode: Decode) -> Message | RemoteError | None:
    try:
        return _read(response, message, decode)
    except RemoteError as error:
        return error


def _read(response: _Response, message: Message, decode: Decode) -> Message | None:
    """Return the answer to the message, or None when it was accepted without one. Raises RemoteError when it was rejected, and Unanswered
    when the recipient cannot process it at this time.

    Peers of other makes accept a message with 200 or 204, with a page, or with an empty envelope, too. That is no answer to a request which
    waits for one here.
    """
    problem: RemoteError | None = None
    if response.status not in UNTAKEN and response.document and response.media_type == soap.MEDIA_TYPE:
        try:
            answer = decode(response.document)
        except WireError as error:
            problem = RemoteError(f"{message.header.recipient} sent an answer that cannot be read: {error}")
        else:
            if isinstance(answer.body, Fault) and answer.body.code == soap.UNAVAILABLE:
                raise Unanswered(f"{message.header.recipient} does not answer now: {answer.body.text}")
            return answer
    waits_here = type(message.body) in REQUESTS and message.header.reply_to == ANONYMOUS
    is_fault = problem is not None and b"Fault" in response.document
    if not is_fault and (response.status == 202 or (200 <= response.status < 300 and not waits_here)):
        return None
    raise problem or _unexpected(response, message)


def _text(response: _Response) -> str:
    """What a response that is no answer says, in a Fault or in plain text."""
    if response.media_type == soap.MEDIA_TYPE:
        with contextlib.suppress(WireError):
            body = soap.decode(response.document).body
            if isinstance(body, Fault):
                return body.text
    return response.document[:500].decode(errors="replace").strip()


def _unexpected(response: _Response, message: Message) -> RemoteError:
    text = _text(response)
    problem = f"{message.header.recipient} answered with HTTP {response.status}{': ' + text if text else ''}"
    return Unanswered(problem) if response.status in UNTAKEN else RemoteError(problem)

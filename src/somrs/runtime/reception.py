"""The reception of messages, in every binding: a message goes to the component at its path, and its sender gets an outcome.

A binding carries documents over a network: SOAP over HTTP (`http.py`, `wire.py`), and msgpack over NATS (`bus.py`).
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Iterable, Mapping
from typing import NamedTuple, TypeVar
from urllib.parse import unquote, urlsplit

from somrs.errors import InputError, RemoteError, WireError
from somrs.protocol.messages import frp
from somrs.protocol.messages.bodies import REQUESTS, FrpBody
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.ranges import check_ranges
from somrs.protocol.soap import soap
from somrs.protocol.soap.document import SENDER
from somrs.runtime.batches import Outcome
from somrs.runtime.proofs import NO_SOURCE, Denials, Source, current_source
from somrs.runtime.reply_hosts import ReplyHosts, check_readable
from somrs.trust.neighbours import OWN_SITE

log = logging.getLogger(__name__)

T = TypeVar("T")

Handler = Callable[[Message], Awaitable[Message | None]]
"""Handles a message; returns the answer, when it goes back on the same connection."""

_STOPPING = "this component is stopping"


class NotTaken(RemoteError):
    """No component accepted the message: the sender has to send it again."""


class Stopped(RemoteError):
    """The reception has stopped while a message waited for its answer: the sender does not know what has become of it."""


class Format(NamedTuple):
    """How a binding writes messages.

    `encode` and `decode` raise WireError for what cannot be written or read. `fault` writes the report of such an error, which relates to
    the message with this id.
    """

    encode: Callable[[Message], bytes]
    decode: Callable[[bytes], Message]
    fault: Callable[[WireError, str | None], bytes]


class Reception:
    """Receives documents in one format for `parts`, the handlers by path. `denials`: refuses what senders have no right to.

    The outcome of a message is 202 when the component accepted it and any answer goes elsewhere, 200 with the answer when the sender waits
    for it, a Fault with the status of SOAP 1.2 part 2, 7.5.2.2, 404 or 503 with a text when no component has accepted it.
    """

    def __init__(self, format: Format, parts: Mapping[str, Handler], denials: Denials | None = None) -> None:
        self._format, self._parts, self._reply_hosts = format, parts, ReplyHosts()
        self._denials = denials if denials is not None else Denials()
        self._open: set[asyncio.Task[object]] = set()
        self.is_stopping = False

    def stop(self) -> None:
        """Give up what waits: it gets the status 503, or the Fault `wsa:EndpointUnavailable` if the component has accepted the message."""
        self.is_stopping = True
        for task in self._open:
            task.cancel()

    @property
    def open_count(self) -> int:
        """How many messages are being received or handled."""
        return len(self._open)

    def check_open(self) -> None:
        """Raises NotTaken when the reception has stopped."""
        if self.is_stopping:
            raise NotTaken(_STOPPING)

    async def outcomes(self, documents: Iterable[bytes], source: Source = NO_SOURCE) -> list[Outcome]:
        """Handle messages in order, each at the component to which it is addressed. `source`: see `outcome`."""
        messages = [await self._read(document, source) for document in documents]
        current_source.set(source)
        return await asyncio.gather(*map(self._handle, messages))

    async def outcome(self, document: bytes, handler: Handler | None = None, source: Source = NO_SOURCE) -> Outcome:
        """Return the outcome of a message at the handler; without a handler, at the component to which it is addressed.

        `source`: where it comes from; by default, from a binding whose members are known.
        """
        message = await self._read(document, source)
        current_source.set(source)
        return await self._handle(message, handler)

    async def _read(self, document: bytes, source: Source) -> Message | Outcome:
        """The message in a document; or the outcome, if it is not one that is handled."""
        message: Message | None = None
        try:
            message = self._format.decode(document)
            if type(message.body) in REQUESTS or isinstance(message.body, FrpBody):
                check_ranges(message.body)
            check_readable(message)
            site = self._denials.check(message, source.proof, source.host or "").site if source.proof is not None else OWN_SITE
            if source.host is not None and site == OWN_SITE:  # the addresses of a neighbour's are at its hosts, of which it has several
                await self._reply_hosts.check(message, source.host)
        except Exception as error:  # noqa: BLE001  # `_refusal` logs a defect
            return self._refusal(error, message)
        return message

    async def _handle(self, message: Message | Outcome, handler: Handler | None = None) -> Outcome:
        if not isinstance(message, Message):
            return message
        try:
            if handler is None:
                path = unquote(urlsplit(message.header.recipient).path)
                handler = self._parts.get(path)
                if handler is None:
                    return 404, self.not_found_text(path).encode()
            answer = await self.unless_stopped(handler(message))
            return self._answer(answer) if answer is not None else (202, b"")
        except Exception as error:  # noqa: BLE001  # `_refusal` logs a defect
            return self._refusal(error, message)

    def _refusal(self, error: Exception, message: Message | None) -> Outcome:
        """The outcome of a message for which this error was raised."""
        match error:
            case WireError():
                return self._fault(error, message)
            case InputError():
                return self._fault(WireError(SENDER, str(error)), message)
            case NotTaken():
                return unavailable(error)
            case Stopped():
                return self._fault(WireError(soap.UNAVAILABLE, str(error)), message)
            case RemoteError():
                return self._fault(WireError(soap.RECEIVER, str(error)), message)
        # A defect here must not end the server, nor show the sender its stack trace.
        log.error("a %s could not be handled", type(message.body).__name__ if message else "message", exc_info=error)
        return self._fault(WireError(soap.RECEIVER, "an internal error occurred; see the log of this program"), message)

    def not_found_text(self, path: str) -> str:
        return f"there is no component at {path}; available: {', '.join(self._parts)}\n"

    async def unless_stopped(self, work: Awaitable[T]) -> T:
        """Return the result of the work. Raises Stopped when the reception stops first."""
        task = asyncio.current_task()
        assert task is not None, "messages are received in tasks"
        self._open.add(task)
        try:
            return await work
        except asyncio.CancelledError:
            if not self.is_stopping:
                raise
            task.uncancel()
            raise Stopped(_STOPPING) from None
        finally:
            self._open.discard(task)

    def _answer(self, answer: Message) -> Outcome:
        try:
            return _status(answer), self._format.encode(answer)
        except WireError as error:
            raise RemoteError(f"the answer, {type(answer.body).__name__}, cannot be sent: {error.text}") from None

    def _fault(self, error: WireError, message: Message | None) -> Outcome:
        relates_to = message.header.message_id if message is not None else None
        return _fault_status(error.code), self._format.fault(error, relates_to)


def unavailable(error: RemoteError) -> Outcome:
    """Return the outcome for a message that was not accepted. It is no answer: the sender has to send the message again."""
    return 503, f"{error}\n".encode()


def _status(answer: Message) -> int:
    if isinstance(answer.body, frp.Fault):
        return _fault_status(answer.body.code)
    return 400 if type(answer.body) in soap.REFUSALS else 200


def _fault_status(code: str) -> int:
    """Return the HTTP status of a Fault (SOAP 1.2 part 2, table 20): 400 for an error of the sender, 500 for all others."""
    of_receiver = ("Receiver", "MustUnderstand", "VersionMismatch", "DataEncodingUnknown", soap.UNAVAILABLE)
    return 500 if code.removeprefix("env:") in of_receiver else 400

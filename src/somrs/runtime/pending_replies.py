"""Requests whose senders wait for an answer on the same connection, and the matching of answers (WS-Addressing, anonymous ReplyTo)."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterator
from contextlib import contextmanager

from msgspec import structs

from somrs.errors import RemoteError
from somrs.protocol.messages import frp
from somrs.protocol.messages.bodies import REPORTS, REQUESTS
from somrs.protocol.messages.envelope import ANONYMOUS, Message

log = logging.getLogger(__name__)


class PendingReplies:
    """The requests of a component that wait for an answer."""

    def __init__(self) -> None:
        self._waiting: dict[asyncio.Future[Message], Message] = {}

    @contextmanager
    def waiting(self, message: Message) -> Iterator[asyncio.Future[Message]]:
        """Yield the future of the answer to the message, for as long as the context is open."""
        reply: asyncio.Future[Message] = asyncio.get_running_loop().create_future()
        self._waiting[reply] = message
        try:
            yield reply
        finally:
            del self._waiting[reply]
            if reply.done() and not reply.cancelled():
                reply.exception()  # mark as retrieved: the waiting request may have ended by another error first

    def answer(self, message: Message) -> None:
        """Pass the answer to all requests that it answers."""
        waiting = [reply for reply, request in self._waiting.items() if not reply.done() and _answers(message, request)]
        for reply in waiting:
            reply.set_result(message)
        if not waiting:
            log.debug("no request waits for this %s any more", type(message.body).__name__)

    def fail_all(self, error: RemoteError) -> None:
        """Fail all requests: there will be no answers."""
        for reply in self._waiting:
            if not reply.done():
                reply.set_exception(error)


def is_waited_for(message: Message) -> bool:
    """Whether the connection of a message without ReplyTo stays open for an answer.

    It does for a request, and for an order of a coordinator without an address, which waits for the participant's report.
    """
    kind = type(message.body)
    return kind in REQUESTS or (kind in REPORTS and message.header.sender == ANONYMOUS)


def _answers(answer: Message, request: Message) -> bool:
    """Whether the message is the answer to the request.

    A heartbeat is not. A repeated report relates to the first order, and also answers the same order when it was sent again.
    """
    if answer.header.relates_to == request.header.message_id:
        return not isinstance(answer.body, frp.Progress)
    session, request_session = ((header.transaction, header.participant) for header in (answer.header, request.header))
    return session == request_session and type(answer.body) in REPORTS.get(type(request.body), ())


def in_session(answer: Message, message: Message) -> Message:
    """Return the answer related to the message, from its recipient and in its session, as far as the answer does not say."""
    request_header, answer_header = message.header, answer.header
    header = structs.replace(
        answer_header,
        sender=answer_header.sender if answer_header.sender != ANONYMOUS else request_header.recipient,
        relates_to=answer_header.relates_to or request_header.message_id,
        transaction=answer_header.transaction or request_header.transaction,
        participant=answer_header.participant or request_header.participant,
    )
    return structs.replace(answer, header=header)

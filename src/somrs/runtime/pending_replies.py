"""Who waits for an answer on the connection that a message came on, and what answers whom (WS-Addressing, anonymous ReplyTo)."""

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
    """Those who wait for an answer of one component."""

    def __init__(self) -> None:
        self._waiting: dict[asyncio.Future[Message], Message] = {}

    @contextmanager
    def waiting(self, message: Message) -> Iterator[asyncio.Future[Message]]:
        """Where the answer to the message comes, as long as it is waited for."""
        reply: asyncio.Future[Message] = asyncio.get_running_loop().create_future()
        self._waiting[reply] = message
        try:
            yield reply
        finally:
            del self._waiting[reply]
            if reply.done() and not reply.cancelled():
                reply.exception()  # whoever waited has heard it, if only by something else that went wrong first

    def answer(self, message: Message) -> None:
        """Give the answer to all whom it answers."""
        waiting = [reply for reply, request in self._waiting.items() if not reply.done() and _answers(message, request)]
        for reply in waiting:
            reply.set_result(message)
        if not waiting:
            log.debug("nobody waits for this %s any more", type(message.body).__name__)

    def fail_all(self, error: RemoteError) -> None:
        """There will be no answers."""
        for reply in self._waiting:
            if not reply.done():
                reply.set_exception(error)


def is_waited_for(message: Message) -> bool:
    """Whether the connection of a message without ReplyTo is kept open: for the answer to a request, or a participant's report
    to a coordinator that has no address."""
    kind = type(message.body)
    return kind in REQUESTS or (kind in REPORTS and message.header.sender == ANONYMOUS)


def _answers(answer: Message, request: Message) -> bool:
    """Whether it is what the one who asked waits for. Signs of life are not; a report that is sent again relates to what was
    told first, and answers those who told it since."""
    if answer.header.relates_to == request.header.message_id:
        return not isinstance(answer.body, frp.Progress)
    session, request_session = ((header.transaction, header.participant) for header in (answer.header, request.header))
    return session == request_session and type(answer.body) in REPORTS.get(type(request.body), ())


def in_session(answer: Message, message: Message) -> Message:
    """The answer, related to the message and in its session: the Fault of a node that could not read it does not know either."""
    request_header, answer_header = message.header, answer.header
    header = structs.replace(
        answer_header,
        relates_to=answer_header.relates_to or request_header.message_id,
        transaction=answer_header.transaction or request_header.transaction,
        participant=answer_header.participant or request_header.participant,
    )
    return structs.replace(answer, header=header)

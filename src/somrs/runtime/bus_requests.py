"""Requests on a bus with certificates: who answers is known, as who asks is.

An answer goes to a subject that names who gives it, in which the servers let nobody else publish. What NATS has for answers does not do: a
server can permit an answer to who got the request, but forgets the open requests whenever the certificates that hold change.
"""

from __future__ import annotations

import asyncio
import logging
import uuid
from collections.abc import Callable
from itertools import count
from typing import TYPE_CHECKING

from somrs.runtime.bus_address import BusAddress, name_of, sender_token
from somrs.storage.nats_connection import INBOXES

if TYPE_CHECKING:
    from nats.aio.client import Client
    from nats.aio.msg import Msg

log = logging.getLogger(__name__)


class Requests:
    """The requests of a process over its connection. `token`: that of its name. `may_answer`: whether who has this name may answer what is
    sent to a subject."""

    def __init__(self, client: Client, address: BusAddress, token: str, may_answer: Callable[[str, str], bool]) -> None:
        self._client, self._address, self._may_answer = client, address, may_answer
        self._inbox = f"{INBOXES}{token}.{uuid.uuid4().hex}"
        self._numbers = count(1)
        self._open: dict[str, tuple[str, asyncio.Future[Msg]]] = {}
        """The open requests by their reply subjects: to which subject they are, and what waits for the answer."""

    async def start(self) -> None:
        """Listen to answers."""
        await self._client.subscribe(f"{self._inbox}.*", cb=self._on_status)
        await self._client.subscribe(answer_subject(self._address, "*", f"{self._inbox}.*"), cb=self._on_answer)

    async def request(self, subject: str, target: str, payload: bytes, timeout: float) -> Msg:
        """Send a request for who listens to a subject, and return the answer. `target`: the subject with who sends it.

        Raises nats.errors.TimeoutError, and NoRespondersError if nobody listens.
        """
        from nats import errors

        reply = f"{self._inbox}.{next(self._numbers)}"
        answer: asyncio.Future[Msg] = asyncio.get_running_loop().create_future()
        self._open[reply] = subject, answer
        try:
            await self._client.publish(target, payload, reply=reply)
            async with asyncio.timeout(timeout):
                return await answer
        except TimeoutError:
            raise errors.TimeoutError from None
        finally:
            del self._open[reply]

    async def _on_status(self, message: Msg) -> None:
        """The servers say that nobody listens. Nobody but they and this program can publish there."""
        from nats import errors

        _, answer = self._open.get(message.subject, (None, None))
        if answer is not None and not answer.done():
            answer.set_exception(errors.NoRespondersError())

    async def _on_answer(self, message: Msg) -> None:
        reply = INBOXES + message.subject.split(".", 4)[4]
        subject, answer = self._open.get(reply, ("", None))
        if answer is None or answer.done():
            return
        name = name_of(sender_token(message.subject))
        if self._may_answer(name, subject):
            answer.set_result(message)
        else:
            log.warning("%s has answered a message to %s, at which it may not listen; the answer is dropped", name, subject)


def answer_subject(address: BusAddress, token: str, reply: str) -> str:
    """The subject for the answer of who has this token to a request with this reply subject."""
    return address.with_sender(address.subject("answers"), token) + f".{reply.removeprefix(INBOXES)}"

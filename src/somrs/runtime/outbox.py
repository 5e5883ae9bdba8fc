"""Outgoing messages: sent in order, repeated until they are acknowledged or expire, and batched where the recipient accepts batches."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Awaitable, Callable, Sequence, Set
from dataclasses import dataclass
from itertools import islice
from typing import Protocol

from somrs.errors import RemoteError
from somrs.kernel.durability import FIRST_PAUSE, LONGEST_PAUSE
from somrs.protocol.messages.envelope import ANONYMOUS, Message
from somrs.runtime.batches import MAX_BATCH_SIZE

log = logging.getLogger(__name__)


class Dispersed(RemoteError):
    """A destination is none any more: its messages go to their recipients separately."""


class Sender(Protocol):
    """The sender of an outgoing message."""

    def handle_acknowledgement(self, outgoing: OutgoingMessage, answer: Message | None) -> None:
        """Handle the acknowledgement of the message, with the answer if one came on the same connection."""
        ...

    def handle_delivery_failure(self, outgoing: OutgoingMessage, reason: str) -> None:
        """Handle the expiry of a message that was not acknowledged."""
        ...


@dataclass(frozen=True, slots=True)
class OutgoingMessage:
    """A message to be sent until `deadline`, and the number by which its sender knows it."""

    sender: Sender
    message: Message
    deadline: float
    number: int = 0


Post = Callable[[Sequence[Message], float], Awaitable[Sequence[Message | RemoteError | None]]]
"""Posts the first messages, as many as go together, within this number of seconds.

Returns for each the answer, or the error for which it was rejected. Raises RemoteError when none was accepted, for a reason that concerns
all, or when there is only one; Dispersed when they have to be sent separately.
"""


class Transport(Protocol):
    """Carries messages to other processes: `wire.Wire` and `bus.Bus`."""

    def destination(self, address: str) -> str | None:
        """What takes batches of messages to this address and others with the same destination; None if messages go one by one."""
        ...

    async def post(self, message: Message, timeout: float) -> Message | None:
        """Send a message. Return the answer, or None when the message was accepted without one. Raises RemoteError."""
        ...

    async def post_separately(self, messages: Sequence[Message], timeout: float) -> Sequence[Message | None]:
        """Send the first of these messages to one address, or more of them, as `Post` says. Raises RemoteError if the first is rejected."""
        ...

    async def post_batch(self, messages: Sequence[Message], timeout: float) -> Sequence[Message | RemoteError | None]:
        """Send the first messages, as `Post` says. All have the same destination."""
        ...


class _Outbox:
    """The messages to one destination. `on_rejected` takes over messages that the recipient rejected: they must not delay later ones."""

    def __init__(self, post: Post, now: Callable[[], float], on_rejected: Callable[[OutgoingMessage], None]) -> None:
        self._post, self._now, self._on_rejected = post, now, on_rejected
        self._waiting: deque[OutgoingMessage] = deque()
        self._task: asyncio.Task[None] | None = None

    @property
    def task(self) -> asyncio.Task[None] | None:
        """The task that sends the waiting messages, if there are any."""
        return self._task

    def enqueue(self, outgoing: OutgoingMessage) -> None:
        self._waiting.append(outgoing)
        if self._task is None:
            self._task = asyncio.create_task(self._send())

    async def _send(self) -> None:
        """Send the waiting messages in order. While the recipient does not answer, give up every message that expires."""
        pause = FIRST_PAUSE
        while self._waiting:
            first = self._waiting[0]
            messages = [outgoing.message for outgoing in islice(self._waiting, MAX_BATCH_SIZE)]
            try:
                outcomes = await self._post(messages, min(max(first.deadline - self._now(), 1.0), 10.0))
            except Dispersed:
                self._reject({outgoing.message.header.recipient for outgoing in self._waiting})
            except RemoteError as error:
                await asyncio.sleep(pause)
                pause = min(pause * 2, LONGEST_PAUSE)
                self._give_up_late(str(error))
            except Exception as error:  # a defect in one message must not hold back those behind it
                log.exception("a %s to %s could not be sent", type(first.message.body).__name__, first.message.header.recipient)
                self._waiting.popleft()
                first.sender.handle_delivery_failure(first, f"{type(error).__name__}: {error}")
            else:
                pause = FIRST_PAUSE
                rejecting: set[str] = set()
                for outcome in outcomes:
                    outgoing = self._waiting.popleft()
                    if isinstance(outcome, RemoteError):
                        rejecting.add(outgoing.message.header.recipient)
                        self._on_rejected(outgoing)
                    else:
                        outgoing.sender.handle_acknowledgement(outgoing, outcome)
                if rejecting:
                    self._reject(rejecting)
        self._task = None

    def _reject(self, recipients: Set[str]) -> None:
        """Hand on the waiting messages to these recipients, which must not overtake those before them."""
        waiting, self._waiting = self._waiting, deque()
        for outgoing in waiting:
            if outgoing.message.header.recipient in recipients:
                self._on_rejected(outgoing)
            else:
                self._waiting.append(outgoing)

    def _give_up_late(self, reason: str) -> None:
        now = self._now()
        late = [outgoing for outgoing in self._waiting if outgoing.deadline <= now]
        self._waiting = deque(outgoing for outgoing in self._waiting if outgoing.deadline > now)
        for outgoing in late:
            outgoing.sender.handle_delivery_failure(outgoing, reason)


class Outboxes:
    """The outboxes of a process: one for each address, and one for each destination that accepts batches.

    The messages to such a destination are collected while a request is under way. `route`: what carries messages to an address;
    `post_separately` sends the first of several messages to one address, or more of them.
    """

    def __init__(
        self,
        route: Callable[[str], Transport],
        post_separately: Post,
        now: Callable[[], float],
    ) -> None:
        self._route, self._post_separately, self._now = route, post_separately, now
        self._by_address: dict[str, _Outbox] = {}
        self._by_destination: dict[str, _Outbox] = {}

    def busy(self, address: str) -> bool:
        """Whether messages to this address wait to be sent separately; later messages have to follow them."""
        box = self._by_address.get(address)
        return box is not None and box.task is not None

    def enqueue(self, outgoing: OutgoingMessage) -> None:
        """Send the message, after those that wait already."""
        header = outgoing.message.header
        # A sender that waits for an answer on the connection must not wait for other messages.
        if self.busy(header.recipient) or header.reply_to == ANONYMOUS:
            self.enqueue_separately(outgoing)
            return
        transport = self._route(header.recipient)
        destination = transport.destination(header.recipient)
        if destination is None:
            self.enqueue_separately(outgoing)
            return
        box = self._by_destination.get(destination)
        if box is None:
            box = self._by_destination[destination] = _Outbox(transport.post_batch, self._now, self.enqueue_separately)
        box.enqueue(outgoing)

    def enqueue_separately(self, outgoing: OutgoingMessage) -> None:
        """Send the message separately, after those to the same address."""
        recipient = outgoing.message.header.recipient
        box = self._by_address.get(recipient)
        if box is None:
            box = self._by_address[recipient] = _Outbox(self._post_separately, self._now, self.enqueue_separately)
        box.enqueue(outgoing)

    async def flush(self, seconds: float) -> None:
        """Wait until all messages are delivered, for at most `seconds`."""
        if sending := self._sending():
            await asyncio.wait(sending, timeout=seconds)

    async def close(self) -> None:
        """Stop sending."""
        sending = self._sending()
        for task in sending:
            task.cancel()
        await asyncio.gather(*sending, return_exceptions=True)

    def _sending(self) -> list[asyncio.Task[None]]:
        return [box.task for box in (*self._by_address.values(), *self._by_destination.values()) if box.task is not None]

"""What a component sends to one address in another process: in order, and again until it is acknowledged or its time is over."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from somrs.errors import RemoteError
from somrs.protocol.envelope import Message
from somrs.protocol.pending import FIRST_PAUSE, LONGEST_PAUSE

log = logging.getLogger(__name__)

Post = Callable[[Message, float], Awaitable[Message | None]]
"""Hands a message over within so many seconds; what came back on the same connection. Raises RemoteError when nobody took it."""


@dataclass(frozen=True, slots=True)
class Letter:
    """A message to be sent until then, and the number by which its sender knows it."""

    message: Message
    until: float
    number: int = 0


class Outbox:
    """`taken` hears which letter was acknowledged, and with which answer; `given_up` which was not, and why."""

    def __init__(
        self,
        post: Post,
        now: Callable[[], float],
        taken: Callable[[Letter, Message | None], None],
        given_up: Callable[[Letter, str], None],
    ) -> None:
        self._post, self._now, self._taken, self._given_up = post, now, taken, given_up
        self._waiting: deque[Letter] = deque()
        self._sender: asyncio.Task[None] | None = None

    @property
    def sender(self) -> asyncio.Task[None] | None:
        """Who sends what waits, if anything does."""
        return self._sender

    def put(self, letter: Letter) -> None:
        self._waiting.append(letter)
        if self._sender is None:
            self._sender = asyncio.create_task(self._send())

    async def _send(self) -> None:
        """Send what waits, in order. While nobody answers, whatever has run out of time is given up, wherever it stands."""
        pause = FIRST_PAUSE
        while self._waiting:
            letter = self._waiting[0]
            try:
                answer = await self._post(letter.message, min(max(letter.until - self._now(), 1.0), 10.0))
            except RemoteError as error:
                await asyncio.sleep(pause)
                pause = min(pause * 2, LONGEST_PAUSE)
                self._give_up_late(str(error))
            except Exception as error:  # a defect in one message must not hold back those behind it
                log.exception("a %s to %s could not be sent", type(letter.message.body).__name__, letter.message.header.recipient)
                self._waiting.popleft()
                self._given_up(letter, f"{type(error).__name__}: {error}")
            else:
                pause = FIRST_PAUSE
                self._waiting.popleft()
                self._taken(letter, answer)
        self._sender = None

    def _give_up_late(self, reason: str) -> None:
        now = self._now()
        late = [letter for letter in self._waiting if letter.until <= now]
        self._waiting = deque(letter for letter in self._waiting if letter.until > now)
        for letter in late:
            self._given_up(letter, reason)

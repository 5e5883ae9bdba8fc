"""The lower bound for such a conversation in Python: calls within one process, msgpack, and a journal; no addresses, sessions, failures or
repeated messages."""

from __future__ import annotations

import asyncio
import uuid
from collections.abc import Callable
from pathlib import Path

import msgspec

from contestants.contest import BIDDERS
from contestants.conversation import Bidder, Negotiation, Note, Speaker
from contestants.journal import Journal

_ENCODER = msgspec.msgpack.Encoder()
_DECODER = msgspec.msgpack.Decoder(Note)

Hear = Callable[[Note], list[Note]]


class Floor:
    """Encodes, delivers and decodes every message, and stores it on disk before the answer."""

    async def start(self, data: Path) -> None:
        self._journal = Journal(data / "floor.sqlite")
        self._speaker = Speaker("task-manager")
        self._open: dict[str, tuple[Negotiation, asyncio.Future[None]]] = {}
        self._running: set[asyncio.Task[None]] = set()
        bidders = {f"robot-{number}": Bidder(f"robot-{number}", number) for number in range(BIDDERS)}
        self._names = tuple(bidders)
        self._ears: dict[str, Hear] = {"task-manager": self._hear, **{name: _answers(bidder) for name, bidder in bidders.items()}}

    async def converse(self, line: int) -> None:
        transaction = uuid.uuid4().urn
        finished: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        negotiation = Negotiation(self._speaker, transaction, self._names)
        self._open[transaction] = negotiation, finished
        for note in negotiation.open():
            self._send(note)
        await finished

    async def stop(self) -> None:
        self._journal.close()

    def _hear(self, note: Note) -> list[Note]:
        negotiation, finished = self._open[note.transaction]
        answers = negotiation.receive(note)
        if negotiation.is_finished:
            del self._open[note.transaction]
            finished.set_result(None)
        return answers

    def _send(self, note: Note) -> None:
        task = asyncio.create_task(self._receive(note.recipient, _ENCODER.encode(note)))
        self._running.add(task)
        task.add_done_callback(self._running.discard)

    async def _receive(self, recipient: str, document: bytes) -> None:
        note = _DECODER.decode(document)
        await self._journal.append(document)
        for answer in self._ears[recipient](note):
            self._send(answer)


def _answers(bidder: Bidder) -> Hear:
    def hear(note: Note) -> list[Note]:
        answer = bidder.answer(note)
        return [answer] if answer is not None else []

    return hear

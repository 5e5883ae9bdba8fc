"""How the inputs of a component are written in its journal: msgpack, with a closed set of values for answers."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
from msgspec import Struct

from somrs.kernel.component import Answered, Rang, Received, Started, Trouble, Undelivered
from somrs.kernel.pending import Entry
from somrs.planner.model.plan import NoPlan, Plan
from somrs.protocol.messages.clients import Records, TaskRecord

Answer = Plan | NoPlan | Records | TaskRecord | Trouble | str | None
"""What the questions of a component with a journal come to."""


class _Answered(Struct, frozen=True, tag="Answered"):
    """`Answered` with what may be in it."""

    question: str
    value: Answer


class _Entry(Struct, frozen=True, array_like=True):
    """`Entry` with what may be in it."""

    number: int
    at: float
    event: Started | Received | Rang | Undelivered | _Answered
    delivered: tuple[int, ...] = ()

    def entry(self) -> Entry:
        event = Answered(self.event.question, self.event.value) if isinstance(self.event, _Answered) else self.event
        return Entry(self.number, self.at, event, self.delivered)


_BATCH = msgspec.msgpack.Decoder(list[_Entry])


def encoded(entry: Entry) -> bytes:
    """An entry as it is in the file. Raises TypeError for what could not be read again."""
    if isinstance(entry.event, Answered) and not isinstance(entry.event.value, Answer):
        raise TypeError(f"the answer to {entry.event.question} cannot be kept: it is a {type(entry.event.value).__name__}")
    return msgspec.msgpack.encode(entry)


def batch(entries: Iterable[bytes]) -> bytes:
    """Encoded entries as one, which is kept in one row: a commit is then one insertion, however many inputs came."""
    return msgspec.msgpack.encode([msgspec.Raw(entry) for entry in entries])


def decoded(document: bytes) -> list[Entry]:
    """The entries of a batch."""
    return [one.entry() for one in _BATCH.decode(document)]

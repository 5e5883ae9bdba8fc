"""The pending effects of a component, and its recovery from a journal, for all runtimes.

A runtime (`runtime.node`, or `runtime.virtual` on virtual time) carries out effects. This module determines what the runtime resumes after
a restart: `PendingEffects` tracks the effects, and `JournaledComponent` restores a component with a journal. It reads no clock and no disk.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import msgspec
from msgspec import Struct

from somrs.kernel import codec
from somrs.kernel.codec import Codec, Schema
from somrs.kernel.component import (
    Answered,
    AnswerLost,
    Ask,
    DeliveryFailed,
    Effect,
    ErrorAnswer,
    Input,
    Notified,
    PartialAnswer,
    Received,
    Record,
    Send,
    SetTimer,
    Started,
    Stateful,
    TimerFired,
    Withdraw,
)
from somrs.kernel.parts import PartsReader, PartsWriter
from somrs.protocol.messages.envelope import ANONYMOUS, Message

DELIVERY_TIME = 30.0
"""Seconds for which a message without `expires_at` is sent again."""

FIRST_PAUSE = 0.05
"""Seconds before a message is sent again for the first time. The pause doubles each time, up to `LONGEST_PAUSE`."""

LONGEST_PAUSE = 1.0

RESTART_DELIVERY_TIME = 10.0
"""Minimum number of seconds for which a message is sent after a restart."""

WITHDRAWN = ErrorAnswer("withdrawn")
"""The answer to a question that was withdrawn before its component restarted: its work is not resumed."""


class Entry(Struct, frozen=True, array_like=True):
    """One input in a journal, and the numbers of the messages that were delivered since the previous entry."""

    number: int
    time: float
    event: Input
    delivered: tuple[int, ...] = ()


class PendingMessage(Struct, frozen=True):
    """A message without acknowledgement, and until when it is sent again (`Send`)."""

    message: Message
    expires_at: float = msgspec.field(name="until")
    strict: bool = False

    def expiry_after_restart(self, now: float) -> float:
        """The time until which a restarted process sends the message."""
        return self.expires_at if self.strict else max(self.expires_at, now + RESTART_DELIVERY_TIME)


NumberedEffect = tuple[Effect, int]
"""An effect, and the number of its message; 0 if it sends no message that may have to be repeated."""


@dataclass(slots=True)
class PendingEffects:
    """Messages without acknowledgement, timers that have not fired, and open questions.

    Messages are numbered in sequence, so that a replay of the same inputs gives the same numbers.
    """

    messages: dict[int, PendingMessage] = field(default_factory=dict)
    timers: dict[Hashable, float] = field(default_factory=dict)
    questions: dict[Hashable, object] = field(default_factory=dict)
    withdrawn: set[Hashable] = field(default_factory=set)
    """The open questions that were withdrawn."""
    message_count: int = 0

    def apply_input(self, event: Input) -> None:
        """Remove the timer or the question that the input concludes."""
        if isinstance(event, TimerFired):
            self.timers.pop(event.timer, None)
        elif isinstance(event, Answered) and not isinstance(event.value, PartialAnswer):
            self.questions.pop(event.question, None)
            self.withdrawn.discard(event.question)

    def apply_effect(self, effect: Effect, now: float) -> int:
        """Register an effect before it is carried out. Returns the number of its message if delivery is required, otherwise 0."""
        # Every effect passes here, and class patterns are slower than `isinstance`.
        if isinstance(effect, Send):
            if effect.message.header.recipient == ANONYMOUS:
                return 0  # the message leaves on an open connection, which ends with this process
            self.message_count += 1
            expires_at = effect.expires_at if effect.expires_at is not None else now + DELIVERY_TIME
            self.messages[self.message_count] = PendingMessage(effect.message, expires_at, effect.strict)
            return self.message_count
        if isinstance(effect, SetTimer):
            if effect.at is None:
                self.timers.pop(effect.timer, None)
            else:
                self.timers[effect.timer] = effect.at
        elif isinstance(effect, Ask):
            self.questions[effect.question] = effect.task
            self.withdrawn.discard(effect.question)
        elif isinstance(effect, Withdraw) and effect.question in self.questions:
            self.withdrawn.add(effect.question)
        return 0

    def find_abandoned_questions(self, volatile: tuple[type, ...]) -> list[tuple[Hashable, ErrorAnswer | AnswerLost]]:
        """The open questions that are not resumed after a restart, and the answer to each."""
        answers: list[tuple[Hashable, ErrorAnswer | AnswerLost]] = []
        for question, task in self.questions.items():
            if question in self.withdrawn:
                answers.append((question, WITHDRAWN))
            elif isinstance(task, volatile):
                answers.append((question, AnswerLost()))
        return answers


@dataclass(slots=True)
class JournaledComponent:
    """A component whose inputs are in a journal before their effects become visible.

    `JournalCodec` serializes it; `replay` handles the entries after a snapshot. `number` and `time` are those of the last entry.
    """

    component: Stateful
    schema: Schema
    pending: PendingEffects = field(default_factory=PendingEffects)
    number: int = 0
    time: float = 0.0
    delivered: list[int] = field(default_factory=list)
    """Messages delivered since the last entry. If this list is lost with the process, they are sent again, which does no harm."""

    def make_entry(self, event: Input, now: float) -> Entry:
        """The journal's next entry, for this input. Write it before any effect of `handle` becomes visible."""
        if isinstance(event, Answered) and isinstance(event.value, BaseException):
            event = Answered(event.question, self.schema.error_to_answer(event.value))
        # A clock that was set back while the process was down must not set back the component's time.
        return Entry(self.number + 1, max(self.time, now), event, tuple(self.delivered))

    def handle(self, entry: Entry) -> list[NumberedEffect]:
        """Have the component handle the input. Its effects may become visible once the entry is in the journal.

        Raises ValueError when an entry before this one is missing.
        """
        if entry.number != self.number + 1:
            raise ValueError(f"entry {self.number + 1} is missing before entry {entry.number}")
        self.number, self.time, self.delivered = entry.number, entry.time, []
        for number in entry.delivered:
            self.pending.messages.pop(number, None)
        self.pending.apply_input(entry.event)
        effects = self.component.handle(entry.event, entry.time)
        return [(effect, self.pending.apply_effect(effect, entry.time)) for effect in effects]

    def mark_delivered(self, number: int) -> None:
        """Remove a message that was acknowledged or given up."""
        if self.pending.messages.pop(number, None) is not None:
            self.delivered.append(number)

    def replay(self, entries: Iterable[Entry]) -> list[Record]:
        """Handle the journal entries after the snapshot again. Returns their records, which may not be on disk yet."""
        records: list[Record] = []
        for entry in entries:
            try:
                effects = self.handle(entry)
            except Exception:  # a defect of the component: the input failed in the same way the first time, and was skipped
                if entry.number != self.number:
                    raise  # the journal itself has a gap
                continue
            records += [effect for effect, _ in effects if isinstance(effect, Record)]
        return records


# Serialization

S = TypeVar("S")
TimerT = TypeVar("TimerT")
QuestionT = TypeVar("QuestionT")
TaskT = TypeVar("TaskT")
AnswerT = TypeVar("AnswerT")
NoticeT = TypeVar("NoticeT")


class Snapshot(Struct, Generic[S, TimerT, QuestionT, TaskT], kw_only=True):
    """The stored form of a `JournaledComponent`."""

    number: int
    time: float = msgspec.field(name="at")
    state: S
    messages: dict[int, PendingMessage]
    timers: list[tuple[TimerT, float]]
    questions: list[tuple[QuestionT, TaskT]]
    withdrawn: list[QuestionT]
    message_count: int = msgspec.field(name="count")
    delivered: list[int]


class _TimerFired(Struct, Generic[TimerT], frozen=True, tag="Rang"):
    timer: TimerT


class _Answered(Struct, Generic[QuestionT, AnswerT], frozen=True, tag="Answered"):
    question: QuestionT
    value: AnswerT


class _Notified(Struct, Generic[NoticeT], frozen=True, tag="Notified"):
    notice: NoticeT


class _Entry(Struct, Generic[TimerT, QuestionT, AnswerT, NoticeT], frozen=True, array_like=True):
    """The stored form of an `Entry`, with the component's own types."""

    number: int
    time: float
    event: Started | Received | DeliveryFailed | _TimerFired[TimerT] | _Answered[QuestionT, AnswerT] | _Notified[NoticeT]
    delivered: tuple[int, ...] = ()

    def to_entry(self) -> Entry:
        event: Input
        match self.event:
            case _TimerFired(timer):
                event = TimerFired(timer)
            case _Answered(question, value):
                event = Answered(question, value)
            case _Notified(notice):
                event = Notified(notice)
            case stored_event:
                event = stored_event
        return Entry(self.number, self.time, event, self.delivered)


class JournalCodec:
    """Serializes and reads the journal of a component with this schema."""

    def __init__(self, schema: Schema) -> None:
        self.schema = schema
        snapshot: Any = Snapshot
        entry: Any = _Entry
        self._snapshot = snapshot[schema.state, schema.timers, schema.questions, schema.tasks]
        self._entries: Codec[list[Any]] = Codec(
            list.__class_getitem__(entry[schema.timers, schema.questions, schema.answers, schema.notices])
        )

    def encode_snapshot(self, journaled: JournaledComponent, parts: PartsWriter | None = None) -> bytes:
        """Serialize a component with its pending effects, without the `parts` that are put aside.

        Raises TypeError or NotImplementedError for a value that is not data.
        """
        pending = journaled.pending
        return codec.encode(
            Snapshot(
                number=journaled.number,
                time=journaled.time,
                state=journaled.component.state,
                messages=pending.messages,
                timers=[*pending.timers.items()],
                questions=[*pending.questions.items()],
                withdrawn=[*pending.withdrawn],
                message_count=pending.message_count,
                delivered=journaled.delivered,
            ),
            parts,
        )

    def decode_snapshot(self, document: bytes, version: int | None = None, parts: PartsReader | None = None) -> JournaledComponent:
        """Restore a component from a snapshot of schema version `version` (None: the current version) and its parts.

        Raises UsageError for a version that cannot be read, and msgspec's errors for other data.
        """
        schema, snapshots = self.schema, Codec[Any](self._snapshot, parts)
        if version in (None, schema.version):
            snapshot = snapshots.decode(document)
        else:
            snapshot = snapshots.convert(schema.migrate_snapshot(codec.decode_untyped(document), version))
        return self._restored(snapshot)

    def converted(self, journaled: JournaledComponent, convert: Callable[[Any], Any]) -> JournaledComponent:
        """The same component with other values in its state and its pending effects. `convert` takes and returns values of
        `codec.decode_untyped`."""
        return self._restored(Codec[Any](self._snapshot).convert(convert(codec.decode_untyped(self.encode_snapshot(journaled)))))

    def _restored(self, snapshot: Any) -> JournaledComponent:
        pending = PendingEffects(
            messages=snapshot.messages,
            timers=dict(snapshot.timers),
            questions=dict(snapshot.questions),
            withdrawn={*snapshot.withdrawn},
            message_count=snapshot.message_count,
        )
        component = self.schema.restore(snapshot.state)
        return JournaledComponent(component, self.schema, pending, snapshot.number, snapshot.time, snapshot.delivered)

    def encode_entry(self, entry: Entry) -> bytes:
        """Serialize one entry. Raises TypeError or NotImplementedError for a value that could not be read back."""
        if isinstance(entry.event, Answered) and not isinstance(entry.event.value, self.schema.answers):
            raise TypeError(f"the answer to {entry.event.question} cannot be kept: it is a {type(entry.event.value).__name__}")
        return codec.encode(entry)

    @staticmethod
    def encode_batch(entries: Iterable[bytes]) -> bytes:
        """Join serialized entries into one document for one row, so that a commit is a single insertion for any number of inputs."""
        return msgspec.msgpack.encode([msgspec.Raw(entry) for entry in entries])

    def decode_batch(self, document: bytes, version: int | None = None) -> list[Entry]:
        """The entries of a batch of schema version `version` (None: the current version)."""
        schema = self.schema
        if version in (None, schema.version):
            return [stored_entry.to_entry() for stored_entry in self._entries.decode(document)]
        return [
            stored_entry.to_entry()
            for stored_entry in self._entries.convert(
                [schema.migrate_entry(raw_entry, version) for raw_entry in codec.decode_untyped(document)]
            )
        ]

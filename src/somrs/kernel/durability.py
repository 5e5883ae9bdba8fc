"""What a component's effects have left under way, and how a component comes back from its journal: the same at every rim.

A rim (`runtime.node`, or `runtime.virtual` on virtual time) carries effects out. What is here says what it has to take up again after a
restart: `PendingEffects` for the effects, `JournaledComponent` for a component whose inputs are kept. Nothing here reads a clock or a disk.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable
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
from somrs.protocol.messages.envelope import ANONYMOUS, Message

DELIVERY_TIME = 30.0
"""Seconds for which a message without a time limit of its own is sent again."""

FIRST_PAUSE = 0.05
"""Seconds before a message is sent again the first time; each time twice as long, up to the longest."""

LONGEST_PAUSE = 1.0

RESTART_DELIVERY_TIME = 10.0
"""Seconds for which a message is sent after a restart at least."""

WITHDRAWN = ErrorAnswer("withdrawn")
"""The answer to a question that was withdrawn before its component was restarted: nobody works on it any more."""


class Entry(Struct, frozen=True, array_like=True):
    """One input in a journal, and which messages, by number, were delivered since the entry before."""

    number: int
    time: float
    event: Input
    delivered: tuple[int, ...] = ()


class PendingMessage(Struct, frozen=True):
    """A message on its way, and until when it is sent again (`Send`)."""

    message: Message
    expires_at: float = msgspec.field(name="until")
    strict: bool = False

    def expiry_after_restart(self, now: float) -> float:
        """Until when it is sent by a process that was away."""
        return self.expires_at if self.strict else max(self.expires_at, now + RESTART_DELIVERY_TIME)


NumberedEffect = tuple[Effect, int]
"""An effect, and the number of the message, if it sends one that may have to be sent again (0 otherwise)."""


@dataclass(slots=True)
class PendingEffects:
    """Messages that nobody has acknowledged, timers that have yet to ring, questions that are open.

    Messages are known by numbers that count up, so that the same inputs give the same numbers once more.
    """

    messages: dict[int, PendingMessage] = field(default_factory=dict)
    timers: dict[Hashable, float] = field(default_factory=dict)
    questions: dict[Hashable, object] = field(default_factory=dict)
    withdrawn: set[Hashable] = field(default_factory=set)
    """Those among the questions that nobody is to work on any more."""
    message_count: int = 0

    def apply_input(self, event: Input) -> None:
        """An input came; what it is the end of is under way no more."""
        if isinstance(event, TimerFired):
            self.timers.pop(event.timer, None)
        elif isinstance(event, Answered) and not isinstance(event.value, PartialAnswer):
            self.questions.pop(event.question, None)
            self.withdrawn.discard(event.question)

    def apply_effect(self, effect: Effect, now: float) -> int:
        """An effect is to be carried out. The number of the message, if it is one that has to arrive; otherwise 0."""
        # Every effect comes this way, and class patterns take longer.
        if isinstance(effect, Send):
            if effect.message.header.recipient == ANONYMOUS:
                return 0  # whoever waited for it on a connection is gone when this process is
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
        """After a restart: the open questions that nobody is to work on, and the answer to each."""
        answers: list[tuple[Hashable, ErrorAnswer | AnswerLost]] = []
        for question, task in self.questions.items():
            if question in self.withdrawn:
                answers.append((question, WITHDRAWN))
            elif isinstance(task, volatile):
                answers.append((question, AnswerLost()))
        return answers


@dataclass(slots=True)
class JournaledComponent:
    """A component whose every input is in a journal before anything that comes of it is seen outside.

    `JournalCodec` has it as bytes; the entries behind it are replayed. `number` and `time` are the last entry's.
    """

    component: Stateful
    schema: Schema
    pending: PendingEffects = field(default_factory=PendingEffects)
    number: int = 0
    time: float = 0.0
    delivered: list[int] = field(default_factory=list)
    """Messages that arrived since the last entry. When they are lost with the process, messages are sent twice, which does no harm."""

    def make_entry(self, event: Input, now: float) -> Entry:
        """The journal's next entry, for this input. It has to be written before `handle`, or with what comes of it."""
        if isinstance(event, Answered) and isinstance(event.value, BaseException):
            event = Answered(event.question, self.schema.error_to_answer(event.value))
        # A clock that was put back while the process was away must not take the component back.
        return Entry(self.number + 1, max(self.time, now), event, tuple(self.delivered))

    def handle(self, entry: Entry) -> list[NumberedEffect]:
        """Have the component handle the input. The effects, which may be seen as soon as the entry is in the journal."""
        if entry.number != self.number + 1:
            raise ValueError(f"entry {self.number + 1} is missing before entry {entry.number}")
        self.number, self.time, self.delivered = entry.number, entry.time, []
        for number in entry.delivered:
            self.pending.messages.pop(number, None)
        self.pending.apply_input(entry.event)
        effects = self.component.handle(entry.event, entry.time)
        return [(effect, self.pending.apply_effect(effect, entry.time)) for effect in effects]

    def mark_delivered(self, number: int) -> None:
        """Somebody acknowledged the message, or it was given up."""
        if self.pending.messages.pop(number, None) is not None:
            self.delivered.append(number)

    def replay(self, entries: Iterable[Entry]) -> list[Record]:
        """Handle again what is in the journal behind the snapshot. Records come out once more: they may not be on disk."""
        records: list[Record] = []
        for entry in entries:
            try:
                effects = self.handle(entry)
            except Exception:  # a defect of the component: it met the input so when it came first, too, and went on as it was then
                if entry.number != self.number:
                    raise  # the journal itself has a gap
                continue
            records += [effect for effect, _ in effects if isinstance(effect, Record)]
        return records


# As bytes

S = TypeVar("S")
TimerT = TypeVar("TimerT")
QuestionT = TypeVar("QuestionT")
TaskT = TypeVar("TaskT")
AnswerT = TypeVar("AnswerT")
NoticeT = TypeVar("NoticeT")


class Snapshot(Struct, Generic[S, TimerT, QuestionT, TaskT], kw_only=True):
    """`JournaledComponent` as it is written."""

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
    """`Entry` with what may be in it."""

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
    """How the journal of a component of this schema is written and read."""

    def __init__(self, schema: Schema) -> None:
        self.schema = schema
        snapshot: Any = Snapshot
        entry: Any = _Entry
        self._snapshots: Codec[Any] = Codec(snapshot[schema.state, schema.timers, schema.questions, schema.tasks])
        self._entries: Codec[list[Any]] = Codec(
            list.__class_getitem__(entry[schema.timers, schema.questions, schema.answers, schema.notices])
        )

    def encode_snapshot(self, journaled: JournaledComponent) -> bytes:
        """The whole of it. Raises TypeError or NotImplementedError where it is no data."""
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
            )
        )

    def decode_snapshot(self, document: bytes, version: int | None = None) -> JournaledComponent:
        """What a snapshot holds that was written with the schema of that version. Raises UsageError for a version that cannot be read,
        and msgspec's errors for what is no snapshot."""
        schema = self.schema
        if version in (None, schema.version):
            snapshot = self._snapshots.decode(document)
        else:
            snapshot = self._snapshots.convert(schema.migrate_snapshot(codec.decode_untyped(document), version))
        pending = PendingEffects(
            messages=snapshot.messages,
            timers=dict(snapshot.timers),
            questions=dict(snapshot.questions),
            withdrawn={*snapshot.withdrawn},
            message_count=snapshot.message_count,
        )
        return JournaledComponent(schema.restore(snapshot.state), schema, pending, snapshot.number, snapshot.time, snapshot.delivered)

    def encode_entry(self, entry: Entry) -> bytes:
        """One entry. Raises TypeError or NotImplementedError for what could not be read again."""
        if isinstance(entry.event, Answered) and not isinstance(entry.event.value, self.schema.answers):
            raise TypeError(f"the answer to {entry.event.question} cannot be kept: it is a {type(entry.event.value).__name__}")
        return codec.encode(entry)

    @staticmethod
    def encode_batch(entries: Iterable[bytes]) -> bytes:
        """Written entries as one, which is kept in one row: a commit is then one insertion, however many inputs came."""
        return msgspec.msgpack.encode([msgspec.Raw(entry) for entry in entries])

    def decode_batch(self, document: bytes, version: int | None = None) -> list[Entry]:
        """The entries of a batch."""
        schema = self.schema
        if version in (None, schema.version):
            return [stored_entry.to_entry() for stored_entry in self._entries.decode(document)]
        return [
            stored_entry.to_entry()
            for stored_entry in self._entries.convert(
                [schema.migrate_entry(raw_entry, version) for raw_entry in codec.decode_untyped(document)]
            )
        ]

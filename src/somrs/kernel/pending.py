"""What a component's effects have left under way, and how a component comes back from its journal: the same at every rim.

A rim (`runtime.node`, or `runtime.virtual` on virtual time) carries effects out. What is here says what it has to take up again after a
restart: `Pending` for the effects, `Journaled` for a component whose inputs are kept. Nothing here reads a clock or a disk.
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
    Ask,
    Effect,
    Input,
    Lost,
    Notified,
    Partial,
    Rang,
    Received,
    Record,
    Send,
    Started,
    Stateful,
    Trouble,
    Undelivered,
    Wake,
    Withdraw,
)
from somrs.protocol.messages.envelope import ANONYMOUS, Message

DELIVERY_TIME = 30.0
"""Seconds for which a message without a time limit of its own is sent again."""

FIRST_PAUSE = 0.05
"""Seconds before a message is sent again the first time; each time twice as long, up to the longest."""

LONGEST_PAUSE = 1.0

AFTER_RESTART = 10.0
"""Seconds for which a message is sent after a restart at least."""

WITHDRAWN = Trouble("withdrawn")
"""The answer to a question that was withdrawn before its component was restarted: nobody works on it any more."""


class Entry(Struct, frozen=True, array_like=True):
    """One input in a journal, and which messages, by number, were delivered since the entry before."""

    number: int
    at: float
    event: Input
    delivered: tuple[int, ...] = ()


class Sent(Struct, frozen=True):
    """A message on its way, and until when it is sent again (`Send`)."""

    message: Message
    until: float
    strict: bool = False

    def after_restart(self, now: float) -> float:
        """Until when it is sent by a process that was away."""
        return self.until if self.strict else max(self.until, now + AFTER_RESTART)


Numbered = tuple[Effect, int]
"""An effect, and the number of the message, if it sends one that may have to be sent again (0 otherwise)."""


@dataclass(slots=True)
class Pending:
    """Messages that nobody has acknowledged, timers that have yet to ring, questions that are open.

    Messages are known by numbers that count up, so that the same inputs give the same numbers once more.
    """

    messages: dict[int, Sent] = field(default_factory=dict)
    timers: dict[Hashable, float] = field(default_factory=dict)
    questions: dict[Hashable, object] = field(default_factory=dict)
    withdrawn: set[Hashable] = field(default_factory=set)
    """Those among the questions that nobody is to work on any more."""
    count: int = 0

    def take(self, event: Input) -> None:
        """An input came; what it is the end of is under way no more."""
        if isinstance(event, Rang):
            self.timers.pop(event.timer, None)
        elif isinstance(event, Answered) and not isinstance(event.value, Partial):
            self.questions.pop(event.question, None)
            self.withdrawn.discard(event.question)

    def apply(self, effect: Effect, now: float) -> int:
        """An effect is to be carried out. The number of the message, if it is one that has to arrive; otherwise 0."""
        # Every effect comes this way, and class patterns take longer.
        if isinstance(effect, Send):
            if effect.message.header.recipient == ANONYMOUS:
                return 0  # whoever waited for it on a connection is gone when this process is
            self.count += 1
            until = effect.until if effect.until is not None else now + DELIVERY_TIME
            self.messages[self.count] = Sent(effect.message, until, effect.strict)
            return self.count
        if isinstance(effect, Wake):
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

    def without_work(self, volatile: tuple[type, ...]) -> list[tuple[Hashable, Trouble | Lost]]:
        """After a restart: the open questions that nobody is to work on, and the answer to each."""
        answers: list[tuple[Hashable, Trouble | Lost]] = []
        for question, task in self.questions.items():
            if question in self.withdrawn:
                answers.append((question, WITHDRAWN))
            elif isinstance(task, volatile):
                answers.append((question, Lost()))
        return answers


@dataclass(slots=True)
class Journaled:
    """A component whose every input is in a journal before anything that comes of it is seen outside.

    `Written` has it as bytes; the entries behind it are replayed. `number` and `at` are the last entry's.
    """

    component: Stateful
    schema: Schema
    pending: Pending = field(default_factory=Pending)
    number: int = 0
    at: float = 0.0
    delivered: list[int] = field(default_factory=list)
    """Messages that arrived since the last entry. When they are lost with the process, messages are sent twice, which does no harm."""

    def entry(self, event: Input, now: float) -> Entry:
        """The journal's next entry, for this input. It has to be written before `handle`, or with what comes of it."""
        if isinstance(event, Answered) and isinstance(event.value, BaseException):
            event = Answered(event.question, self.schema.failure(event.value))
        # A clock that was put back while the process was away must not take the component back.
        return Entry(self.number + 1, max(self.at, now), event, tuple(self.delivered))

    def handle(self, entry: Entry) -> list[Numbered]:
        """Have the component handle the input. The effects, which may be seen as soon as the entry is in the journal."""
        if entry.number != self.number + 1:
            raise ValueError(f"entry {self.number + 1} is missing before entry {entry.number}")
        self.number, self.at, self.delivered = entry.number, entry.at, []
        for number in entry.delivered:
            self.pending.messages.pop(number, None)
        self.pending.take(entry.event)
        effects = self.component.handle(entry.event, entry.at)
        return [(effect, self.pending.apply(effect, entry.at)) for effect in effects]

    def arrived(self, number: int) -> None:
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
    """`Journaled` as it is written."""

    number: int
    at: float
    state: S
    messages: dict[int, Sent]
    timers: list[tuple[TimerT, float]]
    questions: list[tuple[QuestionT, TaskT]]
    withdrawn: list[QuestionT]
    count: int
    delivered: list[int]


class _Rang(Struct, Generic[TimerT], frozen=True, tag="Rang"):
    timer: TimerT


class _Answered(Struct, Generic[QuestionT, AnswerT], frozen=True, tag="Answered"):
    question: QuestionT
    value: AnswerT


class _Notified(Struct, Generic[NoticeT], frozen=True, tag="Notified"):
    notice: NoticeT


class _Entry(Struct, Generic[TimerT, QuestionT, AnswerT, NoticeT], frozen=True, array_like=True):
    """`Entry` with what may be in it."""

    number: int
    at: float
    event: Started | Received | Undelivered | _Rang[TimerT] | _Answered[QuestionT, AnswerT] | _Notified[NoticeT]
    delivered: tuple[int, ...] = ()

    def entry(self) -> Entry:
        event: Input
        match self.event:
            case _Rang(timer):
                event = Rang(timer)
            case _Answered(question, value):
                event = Answered(question, value)
            case _Notified(notice):
                event = Notified(notice)
            case other:
                event = other
        return Entry(self.number, self.at, event, self.delivered)


class Written:
    """How the journal of a component of this schema is written and read."""

    def __init__(self, schema: Schema) -> None:
        self.schema = schema
        snapshot: Any = Snapshot
        entry: Any = _Entry
        self._snapshots: Codec[Any] = Codec(snapshot[schema.state, schema.timers, schema.questions, schema.tasks])
        self._entries: Codec[list[Any]] = Codec(
            list.__class_getitem__(entry[schema.timers, schema.questions, schema.answers, schema.notices])
        )

    def snapshot(self, journaled: Journaled) -> bytes:
        """The whole of it. Raises TypeError or NotImplementedError where it is no data."""
        pending = journaled.pending
        return codec.encoded(
            Snapshot(
                number=journaled.number,
                at=journaled.at,
                state=journaled.component.state,
                messages=pending.messages,
                timers=[*pending.timers.items()],
                questions=[*pending.questions.items()],
                withdrawn=[*pending.withdrawn],
                count=pending.count,
                delivered=journaled.delivered,
            )
        )

    def journaled(self, document: bytes, version: int | None = None) -> Journaled:
        """What a snapshot holds that was written with the schema of that version. Raises UsageError for a version that cannot be read,
        and msgspec's errors for what is no snapshot."""
        schema = self.schema
        if version in (None, schema.version):
            found = self._snapshots.decoded(document)
        else:
            found = self._snapshots.converted(schema.snapshot(codec.plain(document), version))
        pending = Pending(
            messages=found.messages,
            timers=dict(found.timers),
            questions=dict(found.questions),
            withdrawn={*found.withdrawn},
            count=found.count,
        )
        return Journaled(schema.restore(found.state), schema, pending, found.number, found.at, found.delivered)

    def entry(self, entry: Entry) -> bytes:
        """One entry. Raises TypeError or NotImplementedError for what could not be read again."""
        if isinstance(entry.event, Answered) and not isinstance(entry.event.value, self.schema.answers):
            raise TypeError(f"the answer to {entry.event.question} cannot be kept: it is a {type(entry.event.value).__name__}")
        return codec.encoded(entry)

    @staticmethod
    def batch(entries: Iterable[bytes]) -> bytes:
        """Written entries as one, which is kept in one row: a commit is then one insertion, however many inputs came."""
        return msgspec.msgpack.encode([msgspec.Raw(entry) for entry in entries])

    def entries(self, document: bytes, version: int | None = None) -> list[Entry]:
        """The entries of a batch."""
        schema = self.schema
        if version in (None, schema.version):
            return [one.entry() for one in self._entries.decoded(document)]
        return [one.entry() for one in self._entries.converted([schema.entry(one, version) for one in codec.plain(document)])]

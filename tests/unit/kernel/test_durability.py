"""What effects leave under way, and how a component comes back from its journal with it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from msgspec import Struct, structs

from somrs.errors import UsageError
from somrs.kernel.codec import Migration, Schema
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
    TimerFired,
    Withdraw,
)
from somrs.kernel.durability import (
    DELIVERY_TIME,
    RESTART_DELIVERY_TIME,
    WITHDRAWN,
    Entry,
    JournalCodec,
    JournaledComponent,
    PendingEffects,
    PendingMessage,
)
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.protocol.messages.knowledge import ReadMap


def message(recipient: str = "http://b") -> Message:
    return Message(header=Header(sender="http://a", recipient=recipient, message_id="urn:x"), body=ReadMap())


class Due(Struct, frozen=True, tag=True):
    name: str


class Question(Struct, frozen=True, tag=True):
    number: int


class Task(Struct, frozen=True, tag=True):
    text: str


class OtherTask(Struct, frozen=True, tag=True):
    text: str


class Halfway(PartialAnswer, frozen=True):
    pass


QUESTION, OTHER_QUESTION = Question(1), Question(2)
TASK, OTHER_TASK = Task("t"), OtherTask("o")


# Effects


@pytest.mark.parametrize(
    ("send", "pending_message"),
    [
        (Send(message()), PendingMessage(message(), 5.0 + DELIVERY_TIME)),
        (Send(message(), expires_at=0.0), PendingMessage(message(), 0.0)),
        (Send(message(), expires_at=7.0, strict=True), PendingMessage(message(), 7.0, strict=True)),
    ],
)
def test_a_message_is_sent_until_its_time_is_over(send: Send, pending_message: PendingMessage) -> None:
    pending = PendingEffects(message_count=3)
    assert pending.apply_effect(send, 5.0) == 4
    assert pending == PendingEffects(messages={4: pending_message}, message_count=4)


def test_messages_are_numbered_and_answers_on_a_connection_are_not() -> None:
    pending = PendingEffects()
    assert [pending.apply_effect(Send(message(recipient)), 0.0) for recipient in ("http://b", ANONYMOUS, "http://b")] == [1, 0, 2]
    assert (pending.message_count, [*pending.messages]) == (2, [1, 2])


@pytest.mark.parametrize(("strict", "expires_at"), [(True, 5.0), (False, 2.0 + RESTART_DELIVERY_TIME)])
def test_after_a_restart_a_message_has_some_more_seconds(strict: bool, expires_at: float) -> None:
    assert PendingMessage(message(), 5.0, strict).expiry_after_restart(2.0) == expires_at
    assert PendingMessage(message(), 50.0, strict).expiry_after_restart(2.0) == 50.0


@pytest.mark.parametrize(
    ("effect", "pending_after"),
    [
        (
            SetTimer(Due("b"), 7),
            PendingEffects(
                timers={Due("a"): 3.0, Due("b"): 7}, questions={QUESTION: TASK, OTHER_QUESTION: OTHER_TASK}, withdrawn={OTHER_QUESTION}
            ),
        ),
        (
            SetTimer(Due("a"), 4.5),
            PendingEffects(timers={Due("a"): 4.5}, questions={QUESTION: TASK, OTHER_QUESTION: OTHER_TASK}, withdrawn={OTHER_QUESTION}),
        ),
        (SetTimer(Due("a"), None), PendingEffects(questions={QUESTION: TASK, OTHER_QUESTION: OTHER_TASK}, withdrawn={OTHER_QUESTION})),
        (
            SetTimer(Due("b"), None),
            PendingEffects(timers={Due("a"): 3.0}, questions={QUESTION: TASK, OTHER_QUESTION: OTHER_TASK}, withdrawn={OTHER_QUESTION}),
        ),
        (Ask(OTHER_QUESTION, TASK), PendingEffects(timers={Due("a"): 3.0}, questions={QUESTION: TASK, OTHER_QUESTION: TASK})),
        (
            Withdraw(QUESTION),
            PendingEffects(
                timers={Due("a"): 3.0}, questions={QUESTION: TASK, OTHER_QUESTION: OTHER_TASK}, withdrawn={QUESTION, OTHER_QUESTION}
            ),
        ),
        (
            Withdraw(Question(3)),
            PendingEffects(timers={Due("a"): 3.0}, questions={QUESTION: TASK, OTHER_QUESTION: OTHER_TASK}, withdrawn={OTHER_QUESTION}),
        ),
        (
            Record("r"),
            PendingEffects(timers={Due("a"): 3.0}, questions={QUESTION: TASK, OTHER_QUESTION: OTHER_TASK}, withdrawn={OTHER_QUESTION}),
        ),
    ],
)
def test_what_an_effect_leaves_under_way(effect: Effect, pending_after: PendingEffects) -> None:
    pending = PendingEffects(timers={Due("a"): 3.0}, questions={QUESTION: TASK, OTHER_QUESTION: OTHER_TASK}, withdrawn={OTHER_QUESTION})
    assert pending.apply_effect(effect, 1.0) == 0
    assert pending == pending_after


@pytest.mark.parametrize(
    ("event", "pending_after"),
    [
        (TimerFired(Due("a")), PendingEffects(questions={QUESTION: TASK, OTHER_QUESTION: OTHER_TASK}, withdrawn={OTHER_QUESTION})),
        (
            TimerFired(Due("b")),
            PendingEffects(timers={Due("a"): 3.0}, questions={QUESTION: TASK, OTHER_QUESTION: OTHER_TASK}, withdrawn={OTHER_QUESTION}),
        ),
        (Answered(QUESTION, 1), PendingEffects(timers={Due("a"): 3.0}, questions={OTHER_QUESTION: OTHER_TASK}, withdrawn={OTHER_QUESTION})),
        (Answered(OTHER_QUESTION, None), PendingEffects(timers={Due("a"): 3.0}, questions={QUESTION: TASK})),
        (
            Answered(OTHER_QUESTION, Halfway()),
            PendingEffects(timers={Due("a"): 3.0}, questions={QUESTION: TASK, OTHER_QUESTION: OTHER_TASK}, withdrawn={OTHER_QUESTION}),
        ),
        (
            Answered(Question(3), 1),
            PendingEffects(timers={Due("a"): 3.0}, questions={QUESTION: TASK, OTHER_QUESTION: OTHER_TASK}, withdrawn={OTHER_QUESTION}),
        ),
        (
            Started("http://a"),
            PendingEffects(timers={Due("a"): 3.0}, questions={QUESTION: TASK, OTHER_QUESTION: OTHER_TASK}, withdrawn={OTHER_QUESTION}),
        ),
    ],
)
def test_what_an_input_is_the_end_of(event: Input, pending_after: PendingEffects) -> None:
    pending = PendingEffects(timers={Due("a"): 3.0}, questions={QUESTION: TASK, OTHER_QUESTION: OTHER_TASK}, withdrawn={OTHER_QUESTION})
    pending.apply_input(event)
    assert pending == pending_after


def test_after_a_restart_nobody_works_on_what_was_withdrawn_or_ended_with_the_process() -> None:
    pending = PendingEffects(
        questions={Question(n): task for n, task in enumerate((TASK, OTHER_TASK, TASK, OTHER_TASK))}, withdrawn={Question(0), Question(1)}
    )
    assert pending.find_abandoned_questions((OtherTask,)) == [
        (Question(0), WITHDRAWN),
        (Question(1), WITHDRAWN),
        (Question(3), AnswerLost()),
    ]
    assert pending.find_abandoned_questions(()) == [(Question(0), WITHDRAWN), (Question(1), WITHDRAWN)]


# Entries


class RecordedNotices(Struct):
    """What a `NoticeRecorder` was told, and when."""

    notices: list[str]
    times: list[float]


class NoticeRecorder:
    """Notes what it is told, and does then what the test wants."""

    def __init__(self, state: RecordedNotices | None = None, respond: Callable[[str], list[Effect]] = lambda text: []) -> None:
        self.state = state or RecordedNotices([], [])
        self.respond = respond
        self.open: list[str] = []

    def handle(self, event: Input, now: float) -> list[Effect]:
        text = str(event.notice) if isinstance(event, Notified) else type(event).__name__
        self.state.notices.append(text)
        self.state.times.append(now)
        return self.respond(text)


def as_failure(error: BaseException) -> ErrorAnswer:
    return ErrorAnswer(f"so: {error}")


SCHEMA = Schema(
    component="diary", version=3, state=RecordedNotices, timers=Due, questions=Question, tasks=Task | OtherTask,
    answers=int | ErrorAnswer | AnswerLost, notices=str, restore=NoticeRecorder, error_to_answer=as_failure,
)  # fmt: skip


def test_an_entry_follows_the_one_before_and_its_time_does_not_go_back() -> None:
    journaled = JournaledComponent(NoticeRecorder(), SCHEMA, number=4, time=9.0, delivered=[2, 1])
    assert journaled.make_entry(TimerFired(Due("a")), 8.0) == Entry(5, 9.0, TimerFired(Due("a")), (2, 1))
    assert journaled.make_entry(TimerFired(Due("a")), 9.5) == Entry(5, 9.5, TimerFired(Due("a")), (2, 1))
    assert JournaledComponent(NoticeRecorder(), SCHEMA).make_entry(Started("x"), 0.5) == Entry(1, 0.5, Started("x"))


@pytest.mark.parametrize(
    ("value", "stored_value"), [(ValueError("no"), ErrorAnswer("so: no")), (ErrorAnswer("t"), ErrorAnswer("t")), (7, 7)]
)
def test_an_exception_is_kept_as_an_answer(value: object, stored_value: object) -> None:
    assert JournaledComponent(NoticeRecorder(), SCHEMA).make_entry(Answered(QUESTION, value), 0.0).event == Answered(QUESTION, stored_value)


def test_an_entry_is_handled_at_its_time_after_what_it_ends() -> None:
    """The timer that rang is set again by the component: then it is under way once more."""
    effects: list[Effect] = [Send(message()), SetTimer(Due("a"), 8.0), Send(message(ANONYMOUS))]
    pending = PendingEffects(
        messages={1: PendingMessage(message(), 9.0), 2: PendingMessage(message(), 9.0)}, timers={Due("a"): 5.0}, message_count=2
    )
    journaled = JournaledComponent(NoticeRecorder(respond=lambda text: effects), SCHEMA, pending, number=6, time=4.0, delivered=[1, 7])
    assert journaled.handle(Entry(7, 5.0, TimerFired(Due("a")), (1, 7))) == [(effects[0], 3), (effects[1], 0), (effects[2], 0)]
    assert (journaled.number, journaled.time, journaled.delivered) == (7, 5.0, [])
    pending_messages = {2: PendingMessage(message(), 9.0), 3: PendingMessage(message(), 5.0 + DELIVERY_TIME)}
    assert journaled.pending == PendingEffects(messages=pending_messages, timers={Due("a"): 8.0}, message_count=3)
    assert journaled.component.state == RecordedNotices(["TimerFired"], [5.0])


@pytest.mark.parametrize("number", [6, 8])
def test_an_entry_out_of_its_turn_is_an_error(number: int) -> None:
    journaled = JournaledComponent(NoticeRecorder(), SCHEMA, number=6)
    with pytest.raises(ValueError, match=f"^entry 7 is missing before entry {number}$"):
        journaled.handle(Entry(number, 5.0, Started("x")))
    assert (journaled.number, journaled.component.state) == (6, RecordedNotices([], []))


def test_a_gap_in_what_is_handled_again_is_an_error() -> None:
    journaled = JournaledComponent(NoticeRecorder(), SCHEMA, number=6)
    with pytest.raises(ValueError, match=r"^entry 8 is missing before entry 9$"):
        journaled.replay([Entry(7, 5.0, Started("x")), Entry(9, 5.0, Started("x"))])


def test_what_arrived_is_noted_once_and_if_it_was_on_its_way() -> None:
    journaled = JournaledComponent(
        NoticeRecorder(),
        SCHEMA,
        PendingEffects(messages={4: PendingMessage(message(), 9.0), 5: PendingMessage(message(), 9.0)}, message_count=5),
    )
    for number in (5, 5, 6):
        journaled.mark_delivered(number)
    assert (journaled.delivered, [*journaled.pending.messages]) == ([5], [4])


def test_what_is_handled_again_is_recorded_again_and_a_defect_stops_nothing() -> None:
    def respond(text: str) -> list[Effect]:
        if text == "b":
            raise ZeroDivisionError
        return [SetTimer(Due(text), 1.0), Record(text)]

    journaled = JournaledComponent(NoticeRecorder(respond=respond), SCHEMA)
    assert journaled.replay(Entry(n, n / 2, Notified(text)) for n, text in enumerate("abc", 1)) == [Record("a"), Record("c")]
    assert (journaled.number, journaled.time, [*journaled.pending.timers]) == (3, 1.5, [Due("a"), Due("c")])
    assert journaled.component.state == RecordedNotices(["a", "b", "c"], [0.5, 1.0, 1.5])


# As bytes


WRITTEN = JournalCodec(SCHEMA)
JOURNALED = JournaledComponent(
    NoticeRecorder(RecordedNotices(["a"], [0.5])),
    SCHEMA,
    PendingEffects(
        messages={4: PendingMessage(message(), 9.0, strict=True)},
        timers={Due("a"): 3.0},
        questions={QUESTION: TASK, OTHER_QUESTION: OTHER_TASK},
        withdrawn={OTHER_QUESTION},
        message_count=5,
    ),
    number=8,
    time=2.5,
    delivered=[3],
)


@pytest.mark.parametrize("version", [None, 3])
def test_a_snapshot_is_read_as_it_was_written(version: int | None) -> None:
    journaled = WRITTEN.decode_snapshot(WRITTEN.encode_snapshot(JOURNALED), version)
    assert (journaled.number, journaled.time, journaled.delivered, journaled.pending) == (8, 2.5, [3], JOURNALED.pending)
    assert (journaled.schema, type(journaled.component), journaled.component.state) == (SCHEMA, NoticeRecorder, JOURNALED.component.state)


ENTRIES = [
    Entry(1, 0.5, Started("http://a")),
    Entry(2, 0.5, Received(message()), (4, 5)),
    Entry(3, 1.0, DeliveryFailed(message(), "away")),
    Entry(4, 1.0, TimerFired(Due("a"))),
    Entry(5, 1.0, Answered(QUESTION, 7)),
    Entry(6, 1.0, Answered(OTHER_QUESTION, ErrorAnswer("t"))),
    Entry(7, 1.5, Notified("n")),
]


@pytest.mark.parametrize("version", [None, 3])
def test_entries_are_read_as_they_were_written(version: int | None) -> None:
    assert WRITTEN.decode_batch(WRITTEN.encode_batch(map(WRITTEN.encode_entry, ENTRIES)), version) == ENTRIES


def test_an_answer_of_another_type_cannot_be_kept() -> None:
    with pytest.raises(TypeError) as error:
        WRITTEN.encode_entry(Entry(1, 0.0, Answered(QUESTION, "x")))
    assert str(error.value) == "the answer to Question(number=1) cannot be kept: it is a str"


def renamed(snapshot: Any) -> Any:
    snapshot["state"]["notices"] = snapshot["state"].pop("heard")
    return snapshot


def louder(entry: Any) -> Any:
    entry[2]["notice"] += "!"
    return entry


def test_what_earlier_versions_wrote_is_made_that_of_today() -> None:
    written = JournalCodec(structs.replace(SCHEMA, migrations={1: Migration(entry=louder), 2: Migration(snapshot=renamed, entry=louder)}))
    plain = msgspec.msgpack.decode(WRITTEN.encode_snapshot(JOURNALED))
    plain["state"]["heard"] = plain["state"].pop("notices")
    for version in (1, 2):
        journaled = written.decode_snapshot(msgspec.msgpack.encode(plain), version)
        assert (journaled.number, journaled.pending, journaled.component.state) == (8, JOURNALED.pending, JOURNALED.component.state)
        batch = written.encode_batch([written.encode_entry(Entry(1, 0.5, Notified("n")))])
        assert written.decode_batch(batch, version) == [Entry(1, 0.5, Notified("n" + "!" * (3 - version)))]
    for version in (0, 4):
        with pytest.raises(UsageError, match=f"^its data have version {version}, and this program reads up to 3$"):
            written.decode_snapshot(msgspec.msgpack.encode(plain), version)

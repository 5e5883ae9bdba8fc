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
from somrs.kernel.pending import (
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
    what: str


class Question(Struct, frozen=True, tag=True):
    number: int


class Task(Struct, frozen=True, tag=True):
    text: str


class Other(Struct, frozen=True, tag=True):
    text: str


class Halfway(PartialAnswer, frozen=True):
    pass


ASKED, ELSE = Question(1), Question(2)
TASK, OTHER = Task("t"), Other("o")


# Effects


@pytest.mark.parametrize(
    ("send", "sent"),
    [
        (Send(message()), PendingMessage(message(), 5.0 + DELIVERY_TIME)),
        (Send(message(), expires_at=0.0), PendingMessage(message(), 0.0)),
        (Send(message(), expires_at=7.0, strict=True), PendingMessage(message(), 7.0, strict=True)),
    ],
)
def test_a_message_is_sent_until_its_time_is_over(send: Send, sent: PendingMessage) -> None:
    pending = PendingEffects(message_count=3)
    assert pending.apply_effect(send, 5.0) == 4
    assert pending == PendingEffects(messages={4: sent}, message_count=4)


def test_messages_are_numbered_and_answers_on_a_connection_are_not() -> None:
    pending = PendingEffects()
    assert [pending.apply_effect(Send(message(to)), 0.0) for to in ("http://b", ANONYMOUS, "http://b")] == [1, 0, 2]
    assert (pending.message_count, [*pending.messages]) == (2, [1, 2])


@pytest.mark.parametrize(("strict", "until"), [(True, 5.0), (False, 2.0 + RESTART_DELIVERY_TIME)])
def test_after_a_restart_a_message_has_some_more_seconds(strict: bool, until: float) -> None:
    assert PendingMessage(message(), 5.0, strict).expiry_after_restart(2.0) == until
    assert PendingMessage(message(), 50.0, strict).expiry_after_restart(2.0) == 50.0


@pytest.mark.parametrize(
    ("effect", "after"),
    [
        (
            SetTimer(Due("b"), 7),
            PendingEffects(timers={Due("a"): 3.0, Due("b"): 7}, questions={ASKED: TASK, ELSE: OTHER}, withdrawn={ELSE}),
        ),
        (SetTimer(Due("a"), 4.5), PendingEffects(timers={Due("a"): 4.5}, questions={ASKED: TASK, ELSE: OTHER}, withdrawn={ELSE})),
        (SetTimer(Due("a"), None), PendingEffects(questions={ASKED: TASK, ELSE: OTHER}, withdrawn={ELSE})),
        (SetTimer(Due("b"), None), PendingEffects(timers={Due("a"): 3.0}, questions={ASKED: TASK, ELSE: OTHER}, withdrawn={ELSE})),
        (Ask(ELSE, TASK), PendingEffects(timers={Due("a"): 3.0}, questions={ASKED: TASK, ELSE: TASK})),
        (Withdraw(ASKED), PendingEffects(timers={Due("a"): 3.0}, questions={ASKED: TASK, ELSE: OTHER}, withdrawn={ASKED, ELSE})),
        (Withdraw(Question(3)), PendingEffects(timers={Due("a"): 3.0}, questions={ASKED: TASK, ELSE: OTHER}, withdrawn={ELSE})),
        (Record("r"), PendingEffects(timers={Due("a"): 3.0}, questions={ASKED: TASK, ELSE: OTHER}, withdrawn={ELSE})),
    ],
)
def test_what_an_effect_leaves_under_way(effect: Effect, after: PendingEffects) -> None:
    pending = PendingEffects(timers={Due("a"): 3.0}, questions={ASKED: TASK, ELSE: OTHER}, withdrawn={ELSE})
    assert pending.apply_effect(effect, 1.0) == 0
    assert pending == after


@pytest.mark.parametrize(
    ("event", "after"),
    [
        (TimerFired(Due("a")), PendingEffects(questions={ASKED: TASK, ELSE: OTHER}, withdrawn={ELSE})),
        (TimerFired(Due("b")), PendingEffects(timers={Due("a"): 3.0}, questions={ASKED: TASK, ELSE: OTHER}, withdrawn={ELSE})),
        (Answered(ASKED, 1), PendingEffects(timers={Due("a"): 3.0}, questions={ELSE: OTHER}, withdrawn={ELSE})),
        (Answered(ELSE, None), PendingEffects(timers={Due("a"): 3.0}, questions={ASKED: TASK})),
        (Answered(ELSE, Halfway()), PendingEffects(timers={Due("a"): 3.0}, questions={ASKED: TASK, ELSE: OTHER}, withdrawn={ELSE})),
        (Answered(Question(3), 1), PendingEffects(timers={Due("a"): 3.0}, questions={ASKED: TASK, ELSE: OTHER}, withdrawn={ELSE})),
        (Started("http://a"), PendingEffects(timers={Due("a"): 3.0}, questions={ASKED: TASK, ELSE: OTHER}, withdrawn={ELSE})),
    ],
)
def test_what_an_input_is_the_end_of(event: Input, after: PendingEffects) -> None:
    pending = PendingEffects(timers={Due("a"): 3.0}, questions={ASKED: TASK, ELSE: OTHER}, withdrawn={ELSE})
    pending.apply_input(event)
    assert pending == after


def test_after_a_restart_nobody_works_on_what_was_withdrawn_or_ended_with_the_process() -> None:
    pending = PendingEffects(
        questions={Question(n): task for n, task in enumerate((TASK, OTHER, TASK, OTHER))}, withdrawn={Question(0), Question(1)}
    )
    assert pending.find_abandoned_questions((Other,)) == [(Question(0), WITHDRAWN), (Question(1), WITHDRAWN), (Question(3), AnswerLost())]
    assert pending.find_abandoned_questions(()) == [(Question(0), WITHDRAWN), (Question(1), WITHDRAWN)]


# Entries


class Notes(Struct):
    """What a `Diary` was told, and when."""

    told: list[str]
    at: list[float]


class Diary:
    """Notes what it is told, and does then what the test wants."""

    def __init__(self, state: Notes | None = None, does: Callable[[str], list[Effect]] = lambda text: []) -> None:
        self.state = state or Notes([], [])
        self.does = does
        self.open: list[str] = []

    def handle(self, event: Input, now: float) -> list[Effect]:
        text = str(event.notice) if isinstance(event, Notified) else type(event).__name__
        self.state.told.append(text)
        self.state.at.append(now)
        return self.does(text)


def as_failure(error: BaseException) -> ErrorAnswer:
    return ErrorAnswer(f"so: {error}")


SCHEMA = Schema(
    component="diary", version=3, state=Notes, timers=Due, questions=Question, tasks=Task | Other, answers=int | ErrorAnswer | AnswerLost,
    notices=str, restore=Diary, error_to_answer=as_failure,
)  # fmt: skip


def test_an_entry_follows_the_one_before_and_its_time_does_not_go_back() -> None:
    journaled = JournaledComponent(Diary(), SCHEMA, number=4, time=9.0, delivered=[2, 1])
    assert journaled.make_entry(TimerFired(Due("a")), 8.0) == Entry(5, 9.0, TimerFired(Due("a")), (2, 1))
    assert journaled.make_entry(TimerFired(Due("a")), 9.5) == Entry(5, 9.5, TimerFired(Due("a")), (2, 1))
    assert JournaledComponent(Diary(), SCHEMA).make_entry(Started("x"), 0.5) == Entry(1, 0.5, Started("x"))


@pytest.mark.parametrize(("value", "kept"), [(ValueError("no"), ErrorAnswer("so: no")), (ErrorAnswer("t"), ErrorAnswer("t")), (7, 7)])
def test_an_exception_is_kept_as_an_answer(value: object, kept: object) -> None:
    assert JournaledComponent(Diary(), SCHEMA).make_entry(Answered(ASKED, value), 0.0).event == Answered(ASKED, kept)


def test_an_entry_is_handled_at_its_time_after_what_it_ends() -> None:
    """The timer that rang is set again by the component: then it is under way once more."""
    effects: list[Effect] = [Send(message()), SetTimer(Due("a"), 8.0), Send(message(ANONYMOUS))]
    pending = PendingEffects(
        messages={1: PendingMessage(message(), 9.0), 2: PendingMessage(message(), 9.0)}, timers={Due("a"): 5.0}, message_count=2
    )
    journaled = JournaledComponent(Diary(does=lambda text: effects), SCHEMA, pending, number=6, time=4.0, delivered=[1, 7])
    assert journaled.handle(Entry(7, 5.0, TimerFired(Due("a")), (1, 7))) == [(effects[0], 3), (effects[1], 0), (effects[2], 0)]
    assert (journaled.number, journaled.time, journaled.delivered) == (7, 5.0, [])
    left = {2: PendingMessage(message(), 9.0), 3: PendingMessage(message(), 5.0 + DELIVERY_TIME)}
    assert journaled.pending == PendingEffects(messages=left, timers={Due("a"): 8.0}, message_count=3)
    assert journaled.component.state == Notes(["Rang"], [5.0])


@pytest.mark.parametrize("number", [6, 8])
def test_an_entry_out_of_its_turn_is_an_error(number: int) -> None:
    journaled = JournaledComponent(Diary(), SCHEMA, number=6)
    with pytest.raises(ValueError, match=f"^entry 7 is missing before entry {number}$"):
        journaled.handle(Entry(number, 5.0, Started("x")))
    assert (journaled.number, journaled.component.state) == (6, Notes([], []))


def test_a_gap_in_what_is_handled_again_is_an_error() -> None:
    journaled = JournaledComponent(Diary(), SCHEMA, number=6)
    with pytest.raises(ValueError, match=r"^entry 8 is missing before entry 9$"):
        journaled.replay([Entry(7, 5.0, Started("x")), Entry(9, 5.0, Started("x"))])


def test_what_arrived_is_noted_once_and_if_it_was_on_its_way() -> None:
    journaled = JournaledComponent(
        Diary(), SCHEMA, PendingEffects(messages={4: PendingMessage(message(), 9.0), 5: PendingMessage(message(), 9.0)}, message_count=5)
    )
    for number in (5, 5, 6):
        journaled.mark_delivered(number)
    assert (journaled.delivered, [*journaled.pending.messages]) == ([5], [4])


def test_what_is_handled_again_is_recorded_again_and_a_defect_stops_nothing() -> None:
    def does(text: str) -> list[Effect]:
        if text == "b":
            raise ZeroDivisionError
        return [SetTimer(Due(text), 1.0), Record(text)]

    journaled = JournaledComponent(Diary(does=does), SCHEMA)
    assert journaled.replay(Entry(n, n / 2, Notified(text)) for n, text in enumerate("abc", 1)) == [Record("a"), Record("c")]
    assert (journaled.number, journaled.time, [*journaled.pending.timers]) == (3, 1.5, [Due("a"), Due("c")])
    assert journaled.component.state == Notes(["a", "b", "c"], [0.5, 1.0, 1.5])


# As bytes


WRITTEN = JournalCodec(SCHEMA)
JOURNALED = JournaledComponent(
    Diary(Notes(["a"], [0.5])),
    SCHEMA,
    PendingEffects(
        messages={4: PendingMessage(message(), 9.0, strict=True)},
        timers={Due("a"): 3.0},
        questions={ASKED: TASK, ELSE: OTHER},
        withdrawn={ELSE},
        message_count=5,
    ),
    number=8,
    time=2.5,
    delivered=[3],
)


@pytest.mark.parametrize("version", [None, 3])
def test_a_snapshot_is_read_as_it_was_written(version: int | None) -> None:
    found = WRITTEN.decode_snapshot(WRITTEN.encode_snapshot(JOURNALED), version)
    assert (found.number, found.time, found.delivered, found.pending) == (8, 2.5, [3], JOURNALED.pending)
    assert (found.schema, type(found.component), found.component.state) == (SCHEMA, Diary, JOURNALED.component.state)


ENTRIES = [
    Entry(1, 0.5, Started("http://a")),
    Entry(2, 0.5, Received(message()), (4, 5)),
    Entry(3, 1.0, DeliveryFailed(message(), "away")),
    Entry(4, 1.0, TimerFired(Due("a"))),
    Entry(5, 1.0, Answered(ASKED, 7)),
    Entry(6, 1.0, Answered(ELSE, ErrorAnswer("t"))),
    Entry(7, 1.5, Notified("n")),
]


@pytest.mark.parametrize("version", [None, 3])
def test_entries_are_read_as_they_were_written(version: int | None) -> None:
    assert WRITTEN.decode_batch(WRITTEN.encode_batch(map(WRITTEN.encode_entry, ENTRIES)), version) == ENTRIES


def test_an_answer_of_another_type_cannot_be_kept() -> None:
    with pytest.raises(TypeError) as error:
        WRITTEN.encode_entry(Entry(1, 0.0, Answered(ASKED, "x")))
    assert str(error.value) == "the answer to Question(number=1) cannot be kept: it is a str"


def renamed(snapshot: Any) -> Any:
    snapshot["state"]["told"] = snapshot["state"].pop("heard")
    return snapshot


def louder(entry: Any) -> Any:
    entry[2]["notice"] += "!"
    return entry


def test_what_earlier_versions_wrote_is_made_that_of_today() -> None:
    written = JournalCodec(structs.replace(SCHEMA, migrations={1: Migration(entry=louder), 2: Migration(snapshot=renamed, entry=louder)}))
    plain = msgspec.msgpack.decode(WRITTEN.encode_snapshot(JOURNALED))
    plain["state"]["heard"] = plain["state"].pop("told")
    for version in (1, 2):
        found = written.decode_snapshot(msgspec.msgpack.encode(plain), version)
        assert (found.number, found.pending, found.component.state) == (8, JOURNALED.pending, JOURNALED.component.state)
        batch = written.encode_batch([written.encode_entry(Entry(1, 0.5, Notified("n")))])
        assert written.decode_batch(batch, version) == [Entry(1, 0.5, Notified("n" + "!" * (3 - version)))]
    for version in (0, 4):
        with pytest.raises(UsageError, match=f"^its data have version {version}, and this program reads up to 3$"):
            written.decode_snapshot(msgspec.msgpack.encode(plain), version)

"""The rim on virtual time: whatever is lost, late or killed, a component that keeps its inputs ends where one ends that was not."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.errors import UsageError
from somrs.protocol.messages.envelope import Message
from somrs.runtime.virtual_time import KillPoint, Work, World
from tests.support.books import Books
from tests.support.examples import examples
from tests.support.ledger import doubled, expected


@dataclass(frozen=True)
class SendAmount:
    amount: int


@dataclass(frozen=True)
class Kill:
    moment: KillPoint
    effects: int


@dataclass(frozen=True)
class Revive:
    pass


@dataclass(frozen=True)
class TakeOver:
    lingering: float


@dataclass(frozen=True)
class Snapshot:
    pass


@dataclass(frozen=True)
class Wait:
    seconds: float


steps = st.one_of(
    st.builds(SendAmount, st.integers(-99, 99)),
    st.builds(Kill, st.sampled_from(KillPoint), st.integers(0, 5)),
    st.just(Revive()),
    st.builds(TakeOver, st.sampled_from((0.0, 2.0, 30.0))),
    st.just(Snapshot()),
    st.builds(Wait, st.sampled_from((0.0, 0.001, 0.0015, 0.5, 3.0, 40.0))),
)


def medium(seed: int | None) -> World:
    """A world whose messages are lost, late, twice and in any order; None: one where they are not."""
    if seed is None:
        return World()
    dice = random.Random(seed)

    def times(message: Message) -> Sequence[float]:
        return [dice.random() * 4 for _ in range(dice.choice((0, 0, 1, 1, 1, 2)))]

    return World(medium=times)


@examples(75)
@given(st.lists(steps, max_size=25), st.none() | st.integers(0, 2**32))
def test_whenever_it_is_killed_the_sums_are_right_and_everything_is_said(steps: list[object], seed: int | None) -> None:
    books = Books(world=medium(seed))
    books.world.add_standby("ledger")
    for step in steps:
        match step:
            case SendAmount(amount):
                books.send_amount(amount)
            case Kill(moment, effects) if books.world.alive("ledger"):
                books.world.kill("ledger", moment, effects)
            case Revive():
                books.revive()
            case TakeOver(lingering):
                books.world.take_over("ledger", lingering)
            case Snapshot() if books.world.alive("ledger"):
                books.world.snapshot("ledger")
            case Wait(seconds):
                books.world.run(seconds)
    books.revive()
    books.world.run(3600)
    amounts = books.teller.amounts
    assert books.ledger.total == sum(amounts)
    assert books.sink_messages() == expected(amounts)
    assert [*books.ledger.amounts.values()] == [int(entry.effect) for entry in books.world.records["ledger"]]  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("moment", "effects", "message_count", "records"),
    [
        (KillPoint.UNSEEN, 0, 0, 0),
        (KillPoint.JOURNALED, 0, 0, 1),
        (KillPoint.AMID, 1, 0, 0),
        (KillPoint.AMID, 2, 0, 1),
        (KillPoint.AMID, 3, 1, 1),
    ],
)
def test_what_is_out_when_it_is_killed(moment: KillPoint, effects: int, message_count: int, records: int) -> None:
    books = Books()
    books.world.kill("ledger", moment, effects)
    books.send_amount(7)
    assert books.world.alive("ledger")
    books.world.run(1.0)
    assert not books.world.alive("ledger")
    assert len(books.sink.received) == message_count
    assert len(books.world.records["ledger"]) == records
    books.revive()
    books.world.run(0.0001)
    assert books.ledger.total == (0 if moment is KillPoint.UNSEEN else 7)
    books.world.run(10.0)
    assert books.ledger.total == 7, "its teller was not heard, and says it again"
    assert books.sink_messages() == expected([7])


def test_a_journal_keeps_timers_and_questions_and_starts_neither_anew() -> None:
    tasks: list[object] = []

    def noted(task: object) -> Work:
        tasks.append(task)
        yield 3.0, doubled(task)

    books = Books(carry_out=noted)
    books.send_amount(4)
    books.world.run(4.0)
    start_time = books.world.now
    assert books.world.timers("ledger") == {*books.ledger.amounts}
    books.world.kill("ledger")
    books.world.run(0.5)
    books.revive()
    books.world.run(0.499)
    assert tasks == ["4"], "it was answered"
    assert not books.ledger.reminded
    books.world.run(0.01)
    assert books.ledger.reminded, f"5 s after it was told, not after {start_time}"
    books.send_amount(5)
    books.world.run(1.0)
    books.world.kill("ledger")
    books.revive()
    books.world.run(10.0)
    assert tasks == ["4", "5", "5"]
    assert books.ledger.starts == 3


def test_what_is_done_is_not_done_again() -> None:
    books = Books()
    for amount in (1, 2):
        books.send_amount(amount)
        books.world.run(10.0)
    books.world.kill("ledger")
    books.revive()
    books.world.run(20.0)
    first = expected([1])
    assert sorted(message for message in books.sink.received if message in first) == sorted(first)
    assert books.sink_messages() == expected([1, 2])


def test_who_is_not_there_cannot_be_killed_and_who_keeps_nothing_cannot_be_revived() -> None:
    with pytest.raises(UsageError, match="there is no component"):
        World().kill("ledger")
    books = Books()
    with pytest.raises(UsageError, match="has no journal"):
        books.world.snapshot("teller")
    books.world.kill("teller")
    with pytest.raises(UsageError, match="has no journal"):
        books.world.revive("teller")

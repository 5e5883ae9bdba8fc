"""Messages on virtual time that are lost, or whose sender or recipient is killed."""

from __future__ import annotations

from collections.abc import Sequence

from somrs.kernel.component import DeliveryFailed, Effect, Input
from somrs.protocol.messages.envelope import Message
from somrs.runtime.virtual_time import World
from tests.support.books import Books
from tests.support.ledger import Teller, amount_message, expected


def test_a_message_to_one_that_was_killed_waits_until_its_time_is_over() -> None:
    class Notes(Teller):
        undelivered = 0

        def handle(self, event: Input, now: float) -> list[Effect]:
            self.undelivered += isinstance(event, DeliveryFailed)
            return super().handle(event, now)

    books, notes = Books(), Notes()
    books.world.add("notes", notes)
    books.world.kill("ledger")
    books.world.send(amount_message(1, 3, sender="notes"))
    books.world.run(29.0)
    assert notes.undelivered == 0
    books.world.run(2.0)
    assert notes.undelivered == 1
    books.revive()
    books.world.run(60.0)
    assert books.ledger.total == 0


def test_what_a_killed_sender_had_not_got_through_is_sent_when_it_is_back() -> None:
    books = Books()
    books.world.cut_off("sink")
    books.send_amount(3)
    books.world.run(60.0)
    books.world.kill("ledger")
    books.world.reconnect("sink")
    books.world.run(1.0)
    assert not books.sink.received
    books.revive()
    books.world.run(1.0)
    assert books.sink_messages() == expected([3])


def test_what_is_lost_on_the_way_comes_later() -> None:
    tries: list[float] = []

    def lossy(message: Message) -> Sequence[float]:
        tries.append(books.world.now)
        return () if len(tries) < 5 else (0.001,)

    world = World(medium=lambda message: lossy(message))
    books = Books(world=world)
    books.send_amount(1)
    start_time = world.now
    books.world.run(1.0)
    assert books.ledger.total == 1
    assert [round(time - start_time, 3) for time in tries[:5]] == [0.0, 0.05, 0.15, 0.35, 0.75]


def test_two_that_are_separated_reach_all_others() -> None:
    books = Books()
    books.world.separate("ledger", "sink")
    books.world.separate("sink", "ledger")
    books.send_amount(3)
    books.world.run(10.0)
    assert books.ledger.total == 3
    assert not books.sink.received
    books.world.join("ledger", "sink")
    books.world.run(1.0)
    assert not books.sink.received
    books.world.join("ledger", "sink")
    books.world.run(1.0)
    assert books.sink_messages() == expected([3])


def test_a_process_that_was_replaced_goes_on_sending_what_it_had_under_way() -> None:
    books = Books()
    books.world.add_standby("ledger")
    books.world.cut_off("sink")
    books.send_amount(3)
    books.world.run(5.0)
    books.world.take_over("ledger", lingering=30.0)
    books.world.run(5.0)
    books.world.reconnect("sink")
    books.world.run(1.0)
    assert books.sink_messages() == expected([3])
    assert len(books.sink.received) > len(books.sink_messages()), "both processes have sent it"

"""A ledger on virtual time, a teller and a sink."""

from __future__ import annotations

from somrs.runtime.virtual_time import CarryOut, Work, World
from tests.support.ledger import SCHEMA, Ledger, Sink, Teller, doubled


def slowly(task: object) -> Work:
    yield 3.0, doubled(task)


class Books:
    """A ledger, who tells it, and who hears it."""

    def __init__(self, *, world: World | None = None, carry_out: CarryOut = slowly) -> None:
        self.world = world or World()
        self.teller, self.sink = Teller(), Sink()
        self.world.add("sink", self.sink)
        self.world.add("teller", self.teller)
        self.world.add("ledger", Ledger(), carry_out, journaled=SCHEMA)

    @property
    def ledger(self) -> Ledger:
        ledger = self.world.components["ledger"]
        assert isinstance(ledger, Ledger)
        return ledger

    def send_amount(self, amount: int) -> None:
        self.world.fire_timer("teller", str(amount))

    def revive(self) -> None:
        self.world.revive("ledger")

    def sink_messages(self) -> set[tuple[str, str, str]]:
        return set(self.sink.received)

"""A small component for tests of runtimes: it adds up amounts and reports them, and its results are known in advance."""

from __future__ import annotations

from msgspec import Struct

from somrs.kernel.codec import Schema
from somrs.kernel.component import Answered, Ask, Effect, ErrorAnswer, Input, Received, Record, Send, SetTimer, Started, TimerFired
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id, reply
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.records import TaskRecord
from somrs.protocol.messages.submission import CancelTask

LONG = 1e6
"""Seconds for which every message is repeated."""


def amount_message(number: int, amount: int, recipient: str = "ledger", sender: str = "teller", reply_to: str = ANONYMOUS) -> Message:
    header = Header(sender=sender, recipient=recipient, message_id=message_id("told", number), reply_to=reply_to)
    return Message(header=header, body=CancelTask(task=str(amount)))


def doubled(task: object) -> object:
    """Answer a ledger's question."""
    return str(2 * int(str(task)))


class LedgerState(Struct, kw_only=True):
    sink: str
    address: str
    patience: float
    amounts: dict[str, int] = {}
    doubled: dict[str, str] = {}
    reminded: set[str] = set()
    starts: int = 0


class Ledger:
    """Sends three messages to the sink for each amount: a receipt, the double from an Ask, and a reminder from a timer."""

    def __init__(self, sink: str = "sink", address: str = "ledger", patience: float = 5.0) -> None:
        self.state = LedgerState(sink=sink, address=address, patience=patience)

    @classmethod
    def restored(cls, state: LedgerState) -> Ledger:
        ledger = cls()
        ledger.state = state
        return ledger

    @property
    def sink(self) -> str:
        return self.state.sink

    @property
    def address(self) -> str:
        return self.state.address

    @property
    def amounts(self) -> dict[str, int]:
        return self.state.amounts

    @property
    def doubled(self) -> dict[str, str]:
        return self.state.doubled

    @property
    def reminded(self) -> set[str]:
        return self.state.reminded

    @property
    def starts(self) -> int:
        return self.state.starts

    @property
    def total(self) -> int:
        return sum(self.amounts.values())

    @property
    def open(self) -> list[str]:
        """The amounts without an answer of the Ask."""
        return [id for id in self.amounts if id not in self.doubled]

    def handle(self, event: Input, now: float) -> list[Effect]:
        match event:
            case Started():
                self.state.starts += 1
            case Received(message):
                return [*self._received(message, now), Send(reply(message, CancelTask(task=str(self.total)), self.address))]
            case TimerFired(str(timer)):
                self.reminded.add(timer)
                return [self._message_to_sink("reminder", timer, "", now)]
            case Answered(str(question), value):
                self.doubled[question] = str(value)
                return [self._message_to_sink("doubled", question, str(value), now)]
        return []

    def _received(self, message: Message, now: float) -> list[Effect]:
        assert isinstance(message.body, CancelTask)
        id = message.header.message_id
        if id in self.amounts:
            return []
        record = TaskRecord(task=id, client="", effect=message.body.task, submitted_at=now, ended_at=now, outcome=Outcome.ACCOMPLISHED)
        return self._book(record, now)

    def _book(self, entry: TaskRecord, now: float) -> list[Effect]:
        self.amounts[entry.task] = int(entry.effect)
        receipt = self._message_to_sink("receipt", entry.task, entry.effect, now)
        return [SetTimer(entry.task, now + self.state.patience), Record(entry), receipt, Ask(entry.task, entry.effect)]

    def _message_to_sink(self, kind: str, id: str, text: str, now: float) -> Send:
        header = Header(sender=self.address, recipient=self.sink, message_id=message_id(kind, id), reply_to=self.address)
        return Send(Message(header=header, body=CancelTask(task=kind, reason=text)), expires_at=now + LONG)


SCHEMA = Schema(
    component="ledger",
    version=1,
    state=LedgerState,
    timers=str,
    questions=str,
    tasks=str,
    answers=ErrorAnswer | str | None,
    restore=Ledger.restored,
)


def expected(amounts: list[int], first: int = 0) -> set[tuple[str, str, str]]:
    """Return the messages that the sink has to receive for these amounts: kind, text and message id."""
    messages: set[tuple[str, str, str]] = set()
    for number, amount in enumerate(amounts, first):
        id = message_id("told", number)
        for kind, text in (("receipt", str(amount)), ("doubled", str(2 * amount)), ("reminder", "")):
            messages.add((kind, text, message_id(kind, id)))
    return messages


class Sink:
    """Records all messages that it receives, with duplicates."""

    def __init__(self) -> None:
        self.received: list[tuple[str, str, str]] = []

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Received) and isinstance(event.message.body, CancelTask):
            body = event.message.body
            self.received.append((body.task, body.reason, event.message.header.message_id))
        return []


class Teller:
    """Sends the ledger the amount that a timer carries."""

    def __init__(self, ledger: str = "ledger") -> None:
        self.ledger = ledger
        self.amounts: list[int] = []

    def handle(self, event: Input, now: float) -> list[Effect]:
        if not isinstance(event, TimerFired):
            return []
        self.amounts.append(int(str(event.timer)))
        return [Send(amount_message(len(self.amounts) - 1, self.amounts[-1], self.ledger), expires_at=now + LONG)]

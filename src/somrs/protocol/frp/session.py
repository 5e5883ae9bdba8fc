"""A session: the view that one side has of one participant. It creates and records messages.

This module has what both sides share; `participant_session.py` and `coordinator_session.py` follow the tables of `states.py`.

A session reads no clock and sends nothing. `receive` returns what a message means and which messages answer it; `send` creates a message. A
session is data: the journal stores a copy of it, and a session that is read back continues where it stopped.
"""

from __future__ import annotations

from typing import TypeVar

from msgspec import Struct, field, structs

from somrs.entish.formula import conjuncts
from somrs.entish.parse import parse
from somrs.errors import FormulaError, UsageError
from somrs.protocol.frp.states import Entry, Kind
from somrs.protocol.messages.bodies import FrpBody
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id, reply
from somrs.protocol.messages.frp import (
    Accept,
    Arrange,
    Cancel,
    Compensate,
    Compensated,
    Completed,
    End,
    Execute,
    Failed,
    Fault,
    Progress,
    Query,
    Refuse,
    State,
    Status,
    Stop,
    Stopped,
    Stranded,
    Terms,
)

CoordinatorBody = Arrange | Accept | Cancel | Execute | Stop | Compensate | Query | End | Fault
ParticipantBody = Terms | Refuse | Progress | Completed | Failed | Stopped | Compensated | Stranded | Status | Fault

B = TypeVar("B")

NOT_ALLOWED = "frp:NotAllowed"
"""The fault code of a message that its sender may not send in the present state."""

# The message that a message answers: the latest received message of one of these types.
_ANSWERS: dict[str, tuple[str, ...]] = {
    "Terms": ("Arrange",),
    "Refuse": ("Arrange",),
    "Progress": ("Compensate", "Stop", "Execute"),
    "Completed": ("Execute",),
    "Failed": ("Execute", "Accept"),
    "Stopped": ("Stop", "Execute"),
    "Compensated": ("Compensate",),
    "Stranded": ("Compensate",),
    "Accept": ("Terms",),
    "Cancel": ("Terms",),
    "Execute": ("Terms",),
    "Compensate": ("Completed", "Failed", "Stopped"),
}
FLEETING = frozenset(("Progress", "Query", "Status", "Fault"))
"""Monitoring messages. They may come often and change no contract, so neither their ids nor their contents are kept."""


def participant_id(service: str, step: str, attempt: int = 1) -> str:
    """Return the id of a service instance in a step: `Robot1.TransferObject#s1`, and `Robot1.TransferObject#s1.2` at the second attempt."""
    return f"{service}#{step}" if attempt == 1 else f"{service}#{step}.{attempt}"


def service_of(participant: str) -> str:
    """Return the name of the service in a participant's id."""
    return participant.rpartition("#")[0]


class MessageRecord(Struct, frozen=True, kw_only=True, gc=False):
    """The last message of its type in one direction, and the state of the session at that time."""

    id: str
    body: FrpBody
    relates_to: str | None = None
    state: State = State.NEW


class ReceiveResult(Struct, frozen=True, kw_only=True):
    """The meaning of a message: whether it moved the session, from which state to which, and the messages that answer it."""

    kind: Kind
    state_before: State
    state: State
    answers: tuple[Message, ...] = ()

    @property
    def moved(self) -> bool:
        return self.kind is Kind.MOVES


class Session(Struct, kw_only=True):
    """What both sides keep: their addresses, the state, and the last message of each type in each direction."""

    transaction: str
    participant: str
    me: str
    peer: str
    state: State = State.NEW
    reason: str = ""
    """Why the session ended: refused, expired, cancelled, ended, or the reason that the other side gave."""
    number: int = 0
    """The number of messages sent, monitoring messages not counted."""
    sent_messages: dict[str, MessageRecord] = field(default_factory=dict, name="said")
    received_messages: dict[str, MessageRecord] = field(default_factory=dict, name="heard")

    def _check(self, message: Message) -> None:
        header = message.header
        if (header.transaction, header.participant) != (self.transaction, self.participant):
            raise UsageError(
                f"{type(message.body).__name__} is for {header.participant} in {header.transaction}, "
                f"and this is the session of {self.participant} in {self.transaction}: look sessions up by these two ids"
            )

    def _refuse_foreign(self, message: Message, text: str) -> ReceiveResult:
        """Refuse a message of somebody else than the other side, without a trace in the session. A Fault is never answered."""
        answers: tuple[Message, ...] = ()
        if not isinstance(message.body, Fault):
            answer = reply(message, Fault(code=NOT_ALLOWED, text=text), self.me)
            answers = (structs.replace(answer, header=structs.replace(answer.header, recipient=reply_address(message.header))),)
        return ReceiveResult(kind=Kind.FOREIGN, state_before=self.state, state=self.state, answers=answers)

    def _create_message(self, side: str, body: FrpBody, relates_to: str | None = None) -> Message:
        """Create a message. Its id is made from the transaction, the participant, the side, a number and the type."""
        name = type(body).__name__
        if relates_to is None:
            for kind in _ANSWERS.get(name, ()):
                if (request := self.received_messages.get(kind)) is not None:
                    relates_to = request.id
                    break
        if name in FLEETING:
            # Monitoring messages have ids of their own: the journal does not hold them, and after a restart no id may be given to two
            # messages.
            identity = self._fleeting_id(side, name, relates_to)
        else:
            self.number += 1
            identity = message_id(self.transaction, self.participant, side, self.number, name)
        record = MessageRecord(id=identity, body=body, relates_to=relates_to, state=self.state)
        self.sent_messages = {**self.sent_messages, name: record}
        return self._message(record)

    def _fleeting_id(self, side: str, name: str, relates_to: str | None) -> str:
        previous_id = self.sent_messages[name].id if name in self.sent_messages else ""
        return message_id(self.transaction, self.participant, side, self.number, name, relates_to, previous_id)

    def _message(self, record: MessageRecord) -> Message:
        return Message(
            header=Header(
                sender=self.me,
                recipient=self.peer,
                message_id=record.id,
                relates_to=record.relates_to,
                reply_to=self.me,
                transaction=self.transaction,
                participant=self.participant,
            ),
            body=record.body,
        )

    def _repeat(self, *kinds: str) -> tuple[Message, ...]:
        """Return the messages of these types as they were sent, as far as they were."""
        return tuple(self._message(self.sent_messages[kind]) for kind in kinds if kind in self.sent_messages)

    def _record_received(self, message: Message, entry: Entry) -> Entry:
        """Record the message and move. A message that was received before does not move the session again."""
        name, identity = type(message.body).__name__, message.header.message_id
        is_duplicate = name in self.received_messages and self.received_messages[name].id == identity
        if is_duplicate and entry.kind is Kind.MOVES and name not in FLEETING:
            return Entry(Kind.LATE, self.state)
        if entry.kind is Kind.MOVES and (name not in FLEETING or name == "Fault"):
            assert isinstance(message.body, FrpBody)
            self.received_messages = {
                **self.received_messages,
                name: MessageRecord(id=identity, body=message.body, relates_to=message.header.relates_to, state=self.state),
            }
        if entry.kind is Kind.MOVES:
            self.state = entry.next_state
        return entry

    def _state_error(self, kind: type[object], allowed: dict[type[object], State]) -> UsageError:
        allowed_names = ", ".join(message_type.__name__ for message_type in allowed) or "nothing"
        return UsageError(
            f"{self.participant} in {self.transaction} is {self.state.value}: {kind.__name__} is not allowed; allowed: {allowed_names}"
        )

    def copy(self) -> Session:
        """Return a copy that later changes do not affect."""
        return structs.replace(self)


def reply_address(header: Header) -> str:
    """Where the answer to a message goes."""
    return header.sender if header.reply_to == ANONYMOUS else header.reply_to


def unstated_condition(terms: Terms | None, execute: Execute) -> str | None:
    """The condition of the terms, if the order does not say that it holds (Execute: `precondition`); None if it does, or there is none."""
    if terms is None or terms.condition is None:
        return None
    try:
        stated = conjuncts(parse(execute.precondition)) if execute.precondition is not None else ()
        return None if {*conjuncts(parse(terms.condition))} <= {*stated} else terms.condition
    except FormulaError:
        return terms.condition


def body_of_type(messages: dict[str, MessageRecord], kind: type[B]) -> B | None:
    record = messages.get(kind.__name__)
    return record.body if record is not None and isinstance(record.body, kind) else None

"""A session: the view that one side has of one participant. It follows the tables of `states.py` and creates and records messages.

A session reads no clock and sends nothing. `receive` returns what a message means and which messages answer it; `send` creates a message. A
session is data: the journal stores a copy of it, and a session that is read back continues where it stopped.
"""

from __future__ import annotations

from typing import TypeVar

from msgspec import Struct, field, structs

from somrs.errors import UsageError, WireError
from somrs.protocol.frp import states
from somrs.protocol.frp.states import Entry, Kind
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id
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
    Outcome,
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

FrpBody = (
    Arrange | Terms | Refuse | Accept | Cancel | Execute | Progress | Completed | Failed | Stop | Stopped | Compensate | Compensated
    | Stranded | Query | Status | End | Fault
)  # fmt: skip
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
# Monitoring messages may come often and change no contract, so neither their ids nor their contents are kept.
_FLEETING = frozenset(("Progress", "Query", "Status", "Fault"))
_BOUND = states.WORKING | {State.COMMITTED}


def participant_id(service: str, step: str, attempt: int = 1) -> str:
    """Return the id of a service instance in a step: `Robot1.TransferObject#s1`, and `Robot1.TransferObject#s1.2` at the second attempt."""
    return f"{service}#{step}" if attempt == 1 else f"{service}#{step}.{attempt}"


def service_of(participant: str) -> str:
    """Return the name of the service in a participant's id."""
    return participant.rpartition("#")[0]


class MessageRecord(Struct, frozen=True, kw_only=True):
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


class _Session(Struct, kw_only=True):
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

    def _create_message(self, side: str, body: FrpBody, relates_to: str | None = None) -> Message:
        """Create a message. Its id is made from the transaction, the participant, the side, a number and the type."""
        name = type(body).__name__
        if relates_to is None:
            for kind in _ANSWERS.get(name, ()):
                if (request := self.received_messages.get(kind)) is not None:
                    relates_to = request.id
                    break
        if name in _FLEETING:
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
        if is_duplicate and entry.kind is Kind.MOVES and name not in _FLEETING:
            return Entry(Kind.LATE, self.state)
        if entry.kind is Kind.MOVES and (name not in _FLEETING or name == "Fault"):
            assert isinstance(message.body, FrpBody)
            self.received_messages = {
                **self.received_messages,
                name: MessageRecord(id=identity, body=message.body, relates_to=message.header.relates_to, state=self.state),
            }
        if entry.kind is Kind.MOVES:
            self.state = entry.next_state
        return entry

    def copy(self) -> _Session:
        """Return a copy that later changes do not affect."""
        return structs.replace(self)


class ParticipantSession(_Session, tag="participant", kw_only=True):
    """A service's view of its part in one step of one transaction."""

    @classmethod
    def from_message(cls, message: Message, me: str) -> ParticipantSession:
        """Return a new session for the first message to a participant, of any type; pass the message to `receive` next.

        Raises:
            WireError: the header has no transaction or no participant.
        """
        header = message.header
        if header.transaction is None or header.participant is None:
            raise WireError(NOT_ALLOWED, f"{type(message.body).__name__} needs a transaction and a participant in its header")
        return cls(transaction=header.transaction, participant=header.participant, me=me, peer=_reply_address(header))

    def copy(self) -> ParticipantSession:
        return structs.replace(self)

    @property
    def order(self) -> Arrange | None:
        """The Arrange that the coordinator sent."""
        return _body(self.received_messages, Arrange)

    @property
    def terms(self) -> Terms | None:
        """The Terms that this participant offered."""
        return _body(self.sent_messages, Terms)

    @property
    def last_message(self) -> str | None:
        message_ids = [record.id for name, record in self.sent_messages.items() if name not in _FLEETING]
        return message_ids[-1] if message_ids else None

    def receive(self, message: Message) -> ReceiveResult:
        """Return the meaning of the message. A message that a coordinator may not send is ignored or answered with a Fault."""
        self._check(message)
        if not isinstance(message.body, Query | Fault):  # any node may send a Query; its sender does not become the coordinator
            self.peer = _reply_address(message.header)
        state_before, kind = self.state, type(message.body)
        entry = states.PARTICIPANT[state_before].get(kind)
        if entry is None:
            return self._fault(message, f"{kind.__name__} is not for a participant")
        if entry.next_state in _BOUND and (wrong := self._not_accepted(message)):
            return self._fault(message, wrong)
        if entry.next_state is State.COMPENSATING and "Execute" not in self.received_messages:
            entry = states.PARTICIPANT[State.COMMITTED][Compensate]  # a Stop came before the Execute: there is nothing to undo
        entry = self._record_received(message, entry)
        if entry.kind is Kind.MOVES and entry.next_state is State.ENDED:
            self.reason = message.body.reason if isinstance(message.body, Cancel) else "ended"
        return ReceiveResult(kind=entry.kind, state_before=state_before, state=self.state, answers=self._answers(message, entry))

    def send(self, body: ParticipantBody) -> Message:
        """Create a message that answers no other, and move. Raises UsageError when the state does not allow it."""
        kind = type(body)
        allowed = states.PARTICIPANT_SENDS.get(self.state, {})
        if kind not in allowed:
            raise _state_error(self, kind, allowed)
        message = self._create_message("participant", body)
        self.state = allowed[kind]
        if isinstance(body, Refuse):
            self.reason = body.reason
        return message

    def last_report(self) -> tuple[Message, ...]:
        """Return the last report, unchanged, to send it again after a restart: the coordinator may not have received it."""
        report_names = {State.OFFERED: "Terms", State.ENDED: "Refuse"}
        return self._repeat(report_names.get(self.state, self.state.value))

    def _not_accepted(self, message: Message) -> str:
        """Return why an Accept or Execute does not refer to the Terms of this participant; empty when it does."""
        terms = self.sent_messages.get("Terms")
        terms_id = message.body.terms if isinstance(message.body, Accept) else message.header.relates_to
        if isinstance(message.body, Accept | Execute) and self.state is State.OFFERED and terms is not None and terms_id != terms.id:
            return f"{type(message.body).__name__} names the terms {terms_id}, and the offered terms are {terms.id}"
        return ""

    def _answers(self, message: Message, entry: Entry) -> tuple[Message, ...]:
        if entry.answer is None:
            return ()
        name = entry.answer.__name__
        request_name = type(message.body).__name__
        related = message.header.message_id
        bodies: dict[str, ParticipantBody] = {
            "Status": Status(state=self.state, last_message=self.last_message),
            "Fault": Fault(code=NOT_ALLOWED, text=f"{request_name} does not fit the state {self.state.value}"),
            "Failed": Failed(description=f"there is no contract here, so {request_name} started nothing"),
            "Stopped": Stopped(),
            "Stranded": Stranded(description="nothing was done under this contract that could be undone", tried=False),
        }
        if entry.kind is Kind.REPEATED and name not in _FLEETING:
            return self._repeat(name)
        answer = self._create_message("participant", bodies[name], related)
        if entry.answer is Status:
            answer = structs.replace(answer, header=structs.replace(answer.header, recipient=message.header.reply_to))
        return (answer,)

    def _fault(self, message: Message, text: str) -> ReceiveResult:
        if isinstance(message.body, Fault):
            return ReceiveResult(kind=Kind.LATE, state_before=self.state, state=self.state)
        fault = self._create_message("participant", Fault(code=NOT_ALLOWED, text=text), message.header.message_id)
        return ReceiveResult(kind=Kind.LATE, state_before=self.state, state=self.state, answers=(fault,))


class CoordinatorSession(_Session, tag="coordinator", kw_only=True):
    """A Task Manager's view of one participant. `me` and `peer` are the addresses of the two nodes."""

    def copy(self) -> CoordinatorSession:
        return structs.replace(self)

    @property
    def order(self) -> Arrange | None:
        return _body(self.sent_messages, Arrange)

    @property
    def terms(self) -> Terms | None:
        """The Terms that the service offered."""
        return _body(self.received_messages, Terms)

    @property
    def terms_id(self) -> str | None:
        """The id of the Terms, which an Accept names."""
        return self.received_messages["Terms"].id if "Terms" in self.received_messages else None

    def receive(self, message: Message) -> ReceiveResult:
        """Return the meaning of the message: it moves the session, it is a repetition to be answered again, or it is too late."""
        self._check(message)
        state_before, kind = self.state, type(message.body)
        entry = states.COORDINATOR[state_before].get(kind)
        if entry is None or self._belongs_elsewhere(message):
            return ReceiveResult(kind=Kind.LATE, state_before=state_before, state=state_before)
        if self._forgotten(message):
            entry = states.COORDINATOR[state_before][Stranded if state_before is State.COMPENSATING else Failed]
        entry = self._record_received(message, entry)
        if entry.kind is Kind.MOVES and entry.next_state is State.ENDED:
            self.reason = message.body.reason if isinstance(message.body, Refuse) else self.reason or "ended"
        return ReceiveResult(kind=entry.kind, state_before=state_before, state=self.state, answers=self._answers(entry))

    def send(self, body: CoordinatorBody) -> Message:
        """Create a message that answers no other, and move. Raises UsageError when the state does not allow it."""
        kind = type(body)
        if isinstance(body, Query) and self.state is not State.NEW:
            return self._create_message("coordinator", body)
        allowed = states.COORDINATOR_SENDS.get(self.state, {})
        if kind not in allowed:
            raise _state_error(self, kind, allowed)
        if isinstance(body, Accept) and body.terms != self.terms_id:
            raise UsageError(f"{self.participant} offered the terms {self.terms_id}; the Accept names {body.terms}")
        message = self._create_message("coordinator", body)
        self.state = allowed[kind]
        if isinstance(body, Cancel):
            self.reason = body.reason
        elif isinstance(body, End):
            self.reason = "ended"
        return message

    def accept(self) -> Message:
        """Accept the Terms that were offered."""
        if self.terms_id is None:
            raise _state_error(self, Accept, states.COORDINATOR_SENDS.get(self.state, {}))
        return self.send(Accept(terms=self.terms_id))

    def abandon(self) -> bool:
        """Give up a participant that was silent for too long. Return whether the state changed: without a contract, it does not."""
        if self.state not in states.ABANDONED_STATES:
            return False
        self.state = states.ABANDONED_STATES[self.state]
        return True

    def _belongs_elsewhere(self, message: Message) -> bool:
        """Whether the message answers something that this session did not send, or is a Fault about a message that changes no contract."""
        related, body = message.header.relates_to, message.body
        if isinstance(body, Terms | Refuse) and related is not None and "Arrange" in self.sent_messages:
            return related != self.sent_messages["Arrange"].id
        if isinstance(body, Fault):
            binding = ("Arrange", "Accept", "Execute", "Compensate")
            return related not in {self.sent_messages[kind].id for kind in binding if kind in self.sent_messages}
        return False

    def _forgotten(self, message: Message) -> bool:
        """Whether the participant reports that it has no contract, in answer to a Query that was sent after the contract was made."""
        query = self.sent_messages.get("Query")
        return (
            isinstance(message.body, Status)
            and message.body.state is State.NEW
            and self.state in states.CONTRACTED
            and query is not None
            and query.id == message.header.relates_to
            and query.state in states.CONTRACTED
        )

    def _answers(self, entry: Entry) -> tuple[Message, ...]:
        if entry.answer is None:
            return ()
        if entry.kind is Kind.REPEATED:
            return self._repeat("End") or self._repeat("Cancel")
        bodies: dict[str, CoordinatorBody] = {
            "Cancel": Cancel(reason="this service takes no part in the transaction"),
            "End": End(outcome=Outcome.CANCELLED),
            "Stop": Stop(reason="it was silent for too long, and another service may have its step"),
        }
        name = entry.answer.__name__
        return self._repeat(name) or (self._create_message("coordinator", bodies[name]),)


def _reply_address(header: Header) -> str:
    return header.sender if header.reply_to == ANONYMOUS else header.reply_to


def _body(messages: dict[str, MessageRecord], kind: type[B]) -> B | None:
    record = messages.get(kind.__name__)
    return record.body if record is not None and isinstance(record.body, kind) else None


def _state_error(session: _Session, kind: type[object], allowed: dict[type[object], State]) -> UsageError:
    allowed_names = ", ".join(message_type.__name__ for message_type in allowed) or "nothing"
    return UsageError(
        f"{session.participant} in {session.transaction} is {session.state.value}: {kind.__name__} is not allowed; allowed: {allowed_names}"
    )

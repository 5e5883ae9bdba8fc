"""The participant's side of a session."""

from __future__ import annotations

from msgspec import structs

from somrs.errors import WireError
from somrs.protocol.frp import states
from somrs.protocol.frp.session import (
    FLEETING,
    NOT_ALLOWED,
    ParticipantBody,
    ReceiveResult,
    Session,
    body_of_type,
    reply_address,
    unstated_condition,
)
from somrs.protocol.frp.states import Entry, Kind
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import (
    Accept,
    Arrange,
    Cancel,
    Compensate,
    Execute,
    Failed,
    Fault,
    Query,
    Refuse,
    State,
    Status,
    Stopped,
    Stranded,
    Terms,
)

_BOUND = states.WORKING | {State.COMMITTED}


class ParticipantSession(Session, tag="participant", kw_only=True):
    """A service's view of its part in one step of one transaction.

    `peer`: where its reports go. `coordinator`: the sender of the first message, from whom all orders have to come; empty in a session of
    an earlier version, whose coordinator is its `peer`.
    """

    coordinator: str = ""

    @classmethod
    def from_message(cls, message: Message, me: str) -> ParticipantSession:
        """Return a new session for the first message to a participant, of any type; pass the message to `receive` next.

        Raises:
            WireError: the header has no transaction or no participant.
        """
        header = message.header
        if header.transaction is None or header.participant is None:
            raise WireError(NOT_ALLOWED, f"{type(message.body).__name__} needs a transaction and a participant in its header")
        return cls(
            transaction=header.transaction,
            participant=header.participant,
            me=me,
            peer=reply_address(header),
            coordinator=header.sender,
        )

    def copy(self) -> ParticipantSession:
        return structs.replace(self)

    @property
    def order(self) -> Arrange | None:
        """The Arrange that the coordinator sent."""
        return body_of_type(self.received_messages, Arrange)

    @property
    def terms(self) -> Terms | None:
        """The Terms that this participant offered."""
        return body_of_type(self.sent_messages, Terms)

    @property
    def last_message(self) -> str | None:
        message_ids = [record.id for name, record in self.sent_messages.items() if name not in FLEETING]
        return message_ids[-1] if message_ids else None

    def receive(self, message: Message) -> ReceiveResult:
        """Return the meaning of the message. A message that a coordinator may not send is ignored or answered with a Fault."""
        self._check(message)
        state_before, kind = self.state, type(message.body)
        if self.is_foreign(message):
            coordinator = self.coordinator or self.peer
            text = f"{kind.__name__} comes from {message.header.sender}, and {self.participant} takes orders from {coordinator} only"
            return self._refuse_foreign(message, text)
        if kind is not Query:
            self.peer = reply_address(message.header)
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

    def is_foreign(self, message: Message) -> bool:
        """Whether the message is an order of somebody else than the coordinator. Any node may ask for the state."""
        return not isinstance(message.body, Query) and message.header.sender != (self.coordinator or self.peer)

    def send(self, body: ParticipantBody) -> Message:
        """Create a message that answers no other, and move. Raises UsageError when the state does not allow it."""
        kind = type(body)
        allowed = states.PARTICIPANT_SENDS.get(self.state, {})
        if kind not in allowed:
            raise self._state_error(kind, allowed)
        message = self._create_message("participant", body)
        self.state = allowed[kind]
        if isinstance(body, Refuse):
            self.reason = body.reason
        return message

    def objection(self, message: Message, now: float) -> str:
        """Why an order to begin must not be carried out, although the state allows it; empty for all other messages.

        It comes too late, or it does not say that the condition of the terms holds.
        """
        body = message.body
        if isinstance(body, Execute | Compensate) and body.begin_by is not None and now > body.begin_by:
            return (
                f"{type(body).__name__} came {now - body.begin_by:.1f} s too late to begin; nothing was done: "
                "a slow network, or the clocks of the two hosts do not agree"
            )
        if isinstance(body, Execute) and (condition := unstated_condition(self.terms, body)) is not None:
            return f"Execute does not say that {condition}, on which the terms depend; nothing was done"
        return ""

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
            "Stopped": Stopped(tried=False),
            "Stranded": Stranded(description="nothing was done under this contract that could be undone", tried=False),
        }
        if entry.kind is Kind.REPEATED and name not in FLEETING:
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

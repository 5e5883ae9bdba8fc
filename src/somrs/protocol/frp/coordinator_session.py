"""The coordinator's side of a session."""

from __future__ import annotations

from msgspec import structs

from somrs.errors import UsageError
from somrs.protocol.frp import states
from somrs.protocol.frp.session import CoordinatorBody, ReceiveResult, Session, body_of_type, unstated_condition
from somrs.protocol.frp.states import Entry, Kind
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import (
    Accept,
    Arrange,
    Cancel,
    End,
    Execute,
    Failed,
    Fault,
    Outcome,
    Query,
    Refuse,
    State,
    Status,
    Stop,
    Stranded,
    Terms,
)


class CoordinatorSession(Session, tag="coordinator", kw_only=True):
    """A Task Manager's view of one participant. `me` and `peer` are the addresses of the two nodes."""

    def copy(self) -> CoordinatorSession:
        return structs.replace(self)

    @property
    def order(self) -> Arrange | None:
        return body_of_type(self.sent_messages, Arrange)

    @property
    def terms(self) -> Terms | None:
        """The Terms that the service offered."""
        return body_of_type(self.received_messages, Terms)

    @property
    def refusal(self) -> Refuse | None:
        """The Refuse of the service."""
        return body_of_type(self.received_messages, Refuse)

    @property
    def condition(self) -> str | None:
        """The condition on which the service would do the step: that of its refusal, or else that of its terms."""
        refusal, terms = self.refusal, self.terms
        return refusal.condition if refusal is not None else terms.condition if terms is not None else None

    @property
    def invariant(self) -> str | None:
        """What has to hold while the service works, according to its terms."""
        terms = self.terms
        return terms.invariant if terms is not None else None

    @property
    def terms_id(self) -> str | None:
        """The id of the Terms, which an Accept names."""
        return self.received_messages["Terms"].id if "Terms" in self.received_messages else None

    def receive(self, message: Message) -> ReceiveResult:
        """Return the meaning of the message: it moves the session, it is a repetition to be answered again, or it is too late."""
        self._check(message)
        state_before, kind = self.state, type(message.body)
        if message.header.sender != self.peer:
            text = f"{kind.__name__} comes from {message.header.sender}, and {self.participant} is at {self.peer}"
            return self._refuse_foreign(message, text)
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
            raise self._state_error(kind, allowed)
        if isinstance(body, Accept) and body.terms != self.terms_id:
            raise UsageError(f"{self.participant} offered the terms {self.terms_id}; the Accept names {body.terms}")
        if isinstance(body, Execute) and (condition := unstated_condition(self.terms, body)) is not None:
            raise UsageError(f"{self.participant} offered its terms on the condition {condition}; the Execute does not say that it holds")
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
            raise self._state_error(Accept, states.COORDINATOR_SENDS.get(self.state, {}))
        return self.send(Accept(terms=self.terms_id))

    def last_order(self) -> tuple[Message, ...]:
        """The order that has not been reported on, unchanged: a participant that has reported repeats its report."""
        names = {State.EXECUTING: "Execute", State.STOPPING: "Stop", State.COMPENSATING: "Compensate"}
        return self._repeat(names[self.state]) if self.state in names else ()

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
        """Whether the participant reports that it has no contract, in answer to a Query that was sent after the contract was made.

        It may have lost its data; or somebody else has ended the contract, and it never works under it again.
        """
        query = self.sent_messages.get("Query")
        return (
            isinstance(message.body, Status)
            and message.body.state in (State.NEW, State.ENDED)
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

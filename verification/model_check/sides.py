"""The two sides of one participant's part: the product's sessions, run for every message and every choice.

A side's state is a session with the model's additions. States are numbered. The session computes the result of a state and a message once;
the result is stored, so that the exploration handles only numbers. `participant.py` and `coordinator.py` implement the two sides; this
module has what they share.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Generic, NamedTuple, TypeVar

from msgspec import structs

from somrs.errors import UsageError
from somrs.protocol.frp.coordinator_session import CoordinatorSession
from somrs.protocol.frp.participant_session import ParticipantSession
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import State
from verification.model_check.futures import Futures
from verification.model_check.property import Property

TM, SM, TRANSACTION, PARTICIPANT = "tm", "sm", "t", "service#step"
FLEETING = ("Progress", "Status", "Fault", "Query")

LAPSED, NOW = 0.0, 1.0
"""The `begin_by` of an order that has expired by the participant's clock, and the time on it. Orders in time have no `begin_by`."""


class Fair(IntEnum):
    """Whether a fair run contains a move that remains possible for long enough."""

    NO = 0
    """A fault, a timer, or a decision of the client."""
    ENDING = 1
    """The end of work by itself. It is fair, but some work never ends, and then a cancel has to end it."""
    YES = 2


class Action(NamedTuple):
    """A step of a side, of its own accord or on receiving a message. `joint` names the transaction's rule for it, if there is one."""

    description: str
    target: int
    tokens: tuple[int, ...] = ()
    fair: Fair = Fair.NO
    joint: str = ""
    wrong: str = ""
    """Why this step violates a property; empty if it does not."""
    violates: Property = Property.VALID_STATE
    """The property that a wrong step violates."""


class MessageTable:
    """The messages of one direction, by number. A repeated message has the same number."""

    def __init__(self) -> None:
        self.messages: list[Message] = []
        self._numbers: dict[object, int] = {}
        self._count: dict[str, int] = {}

    def number(self, message: Message, count: int) -> int:
        """Return the message's number. `count` is the sender's own number of it."""
        key = _identity(message)
        if key not in self._numbers:
            self._numbers[key] = len(self.messages)
            self.messages.append(message)
        self._count.setdefault(message.header.message_id, count)
        return self._numbers[key]

    def prepare(self, session: CoordinatorSession | ParticipantSession, kind: type[object] | None) -> None:
        """Have the session count the messages of each type separately, so that the id of a message does not depend on messages of other
        types."""
        record = session.sent_messages.get(kind.__name__) if kind is not None else None
        session.number = self._count.get(record.id, 0) if record is not None else 0

    def lapsed(self, token: int) -> int:
        """Return the number of the same order after it has expired; the token itself if it is no order or has expired already."""
        message = self.messages[token]
        if not isinstance(message.body, frp.Execute | frp.Compensate) or is_late(message):
            return token
        late = structs.replace(message, body=structs.replace(message.body, begin_by=LAPSED))
        return self.number(late, self._count[message.header.message_id])

    def prepare_repeat(self, session: CoordinatorSession, kind: type[object]) -> None:
        """As `prepare`, for an order that is sent again: it gets the same number, as it has the same meaning for the receiver."""
        self.prepare(session, kind)
        session.number -= 1

    def name(self, token: int) -> str:
        return type(self.messages[token].body).__name__

    def description(self, token: int) -> str:
        return describe(self.messages[token].body)

    def mask_of(self, kinds: frozenset[type[object]]) -> int:
        """Return the bit mask of the messages of these types."""
        return sum(1 << token for token, message in enumerate(self.messages) if type(message.body) in kinds)


def _identity(message: Message) -> object:
    """Return a key that is equal for messages that mean the same to the receiver. For a Status, only whether the state is New matters."""
    body, header = message.body, message.header
    if isinstance(body, frp.Status):
        return "Status", body.state is State.NEW, header.relates_to
    if isinstance(body, frp.Progress):
        return "Progress"
    if isinstance(body, frp.Fault):
        return "Fault", header.relates_to
    if is_late(message):
        return "late", header.message_id, variant(body)
    return header.message_id, variant(body)


def variant(body: object) -> object:
    """What distinguishes messages of one type on which a decision depends; None for the variant that says nothing special."""
    match body:
        case frp.Arrange(situation=situation):
            return situation
        case frp.Terms(condition=condition):
            return condition
        case frp.Refuse(not_now=not_now, condition=condition):
            return (not_now, condition) if not_now or condition is not None else None
        case frp.Execute(precondition=precondition):
            return precondition
        case frp.Failed(tried=False) | frp.Stopped(tried=False):
            return "nothing was begun"
    return None


def is_late(message: Message) -> bool:
    """Whether the message is an order that has expired."""
    return isinstance(message.body, frp.Execute | frp.Compensate) and message.body.begin_by == LAPSED


def key(session: CoordinatorSession | ParticipantSession, matters: Callable[[State, str], bool]) -> object:
    sent_keys = sorted(
        (name, record.id, record.state if name == "Query" else "", str(variant(record.body)))
        for name, record in session.sent_messages.items()
    )
    received_keys = sorted(
        (name, record.id, str(variant(record.body)))
        for name, record in session.received_messages.items()
        if matters(session.state, name) or variant(record.body) is not None
    )
    return session.state, tuple(sent_keys), tuple(received_keys)


S = TypeVar("S")


@dataclass
class Side(ABC, Generic[S]):
    """The states of one side by number, and the results of each, computed once."""

    inbox: MessageTable
    outbox: MessageTable
    futures: Futures
    states: list[S] = field(default_factory=list)
    _numbers: dict[object, int] = field(default_factory=dict)
    reactions: dict[tuple[int, int], Action] = field(default_factory=dict)
    """The result of each message in each state in which it arrived."""
    _actions: dict[int, tuple[Action, ...]] = field(default_factory=dict)

    def _number(self, key: object, state: S) -> int:
        if key not in self._numbers:
            self._numbers[key] = len(self.states)
            self.states.append(state)
        return self._numbers[key]

    def receive(self, state_number: int, token: int) -> Action:
        """Return the result of receiving the message in this state."""
        if (state_number, token) not in self.reactions:
            description = f"receives {'late ' if is_late(self.inbox.messages[token]) else ''}{self.inbox.description(token)}"
            self.reactions[state_number, token] = try_action(
                lambda: self._receive(state_number, token, description), description, state_number
            )
        return self.reactions[state_number, token]

    def actions(self, state_number: int) -> tuple[Action, ...]:
        """Return the steps that the side may take of its own accord."""
        if state_number not in self._actions:
            self._actions[state_number] = tuple(self._all_actions(state_number))
        return self._actions[state_number]

    @abstractmethod
    def _receive(self, state_number: int, token: int, description: str) -> Action: ...

    @abstractmethod
    def _all_actions(self, state_number: int) -> Iterator[Action]: ...

    def _number_messages(
        self, session: CoordinatorSession | ParticipantSession, messages: tuple[Message, ...]
    ) -> tuple[tuple[int, ...], str]:
        """Return the messages' numbers, and the error if one of them is a Fault."""
        numbers = tuple(self.outbox.number(message, session.number) for message in messages)
        fault = next((message.body.text for message in messages if isinstance(message.body, frp.Fault)), "")
        return numbers, f"an unexpected message: {fault}" if fault else ""


def describe(body: object) -> str:
    """The type of the message, and what its variant says."""
    name = type(body).__name__
    match body:
        case frp.Arrange(situation=str()) | frp.Execute(precondition=str()):
            return f"{name} (open)"
        case frp.Terms(condition=str()) | frp.Refuse(condition=str()):
            return f"{name} (if open)"
        case frp.Refuse(not_now=True):
            return f"{name} (not now)"
        case frp.Failed(tried=False) | frp.Stopped(tried=False):
            return f"{name} (not begun)"
    return name


def try_action(action: Callable[[], Action], description: str, state_number: int) -> Action:
    """Return the result of the action. An action that the session rejects becomes an `Action` that is `wrong`: the table has an error."""
    try:
        return action()
    except (UsageError, KeyError, AssertionError) as error:
        return Action(description, state_number, wrong=f"{description}: {error}")


def forget_fleeting(session: ParticipantSession | CoordinatorSession) -> None:
    """Remove heartbeats and other repeatable messages from the session's records, which keeps the number of states finite."""
    session.sent_messages = {name: record for name, record in session.sent_messages.items() if name not in FLEETING or name == "Query"}

"""The two sides of one participant's part: the sessions that run, played for every message and every choice they have.

A side's state is a session with what the model knows besides. States are numbered, and what comes of a state and a message is
worked out once by the session itself, and remembered: the exploration then handles numbers only. `participant.py` and
`coordinator.py` are the two; here is what they share.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Generic, NamedTuple, TypeVar

from msgspec import structs

from somrs.errors import UsageError
from somrs.protocol.frp.session import CoordinatorSession, ParticipantSession
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import State
from verification.model_check.futures import Futures

TM, SM, TRANSACTION, PARTICIPANT = "tm", "sm", "t", "service#step"
FLEETING = ("Progress", "Status", "Fault", "Query")

LAPSED = 0.0
"""The `begin_by` of an order that is too late to begin with, by the participant's clock. The others have none, and are in time."""


class Fair(IntEnum):
    """Whether a fair run has it happen, if it can for long enough."""

    NO = 0
    """A fault, a timer, a change of mind."""
    ENDING = 1
    """Work comes to an end by itself. That is fair, but there is work that never does, and then a cancel has to help."""
    YES = 2


class Action(NamedTuple):
    """Something that a side does or hears. `joint` names the rule of the transaction that it is subject to, if it is."""

    description: str
    target: int
    tokens: tuple[int, ...] = ()
    fair: Fair = Fair.NO
    joint: str = ""
    wrong: str = ""
    """Why this must never happen."""


class MessageTable:
    """The messages of one direction by number. The same message, sent again, has the same number."""

    def __init__(self) -> None:
        self.messages: list[Message] = []
        self._numbers: dict[object, int] = {}
        self._count: dict[str, int] = {}

    def number(self, message: Message, count: int) -> int:
        """`count`: the sender's number of it."""
        key = _identity(message)
        if key not in self._numbers:
            self._numbers[key] = len(self.messages)
            self.messages.append(message)
        self._count.setdefault(message.header.message_id, count)
        return self._numbers[key]

    def prepare(self, session: CoordinatorSession | ParticipantSession, kind: type[object] | None) -> None:
        """Have the session count the messages of each type apart. Messages of one type are told apart as before, and
        what was said before it does not make it another message."""
        record = session.sent_messages.get(kind.__name__) if kind is not None else None
        session.number = self._count.get(record.id, 0) if record is not None else 0

    def lapsed(self, token: int) -> int:
        """The same message, too late to begin with; itself when it is no order, or is too late already."""
        message = self.messages[token]
        if not isinstance(message.body, frp.Execute | frp.Compensate) or is_late(message):
            return token
        late = structs.replace(message, body=structs.replace(message.body, begin_by=LAPSED))
        return self.number(late, self._count[message.header.message_id])

    def prepare_repeat(self, session: CoordinatorSession, kind: type[object]) -> None:
        """As `prepare`, to say the same again under the same number: to whoever hears it, both mean the same."""
        self.prepare(session, kind)
        session.number -= 1

    def name(self, token: int) -> str:
        return type(self.messages[token].body).__name__

    def mask_of(self, kinds: frozenset[type[object]]) -> int:
        """The set of those of these types."""
        return sum(1 << token for token, message in enumerate(self.messages) if type(message.body) in kinds)


def _identity(message: Message) -> object:
    """What makes two messages the same to whoever hears them. Of a Status, that is whether it knows of anything at all."""
    body, header = message.body, message.header
    if isinstance(body, frp.Status):
        return "Status", body.state is State.NEW, header.relates_to
    if isinstance(body, frp.Progress):
        return "Progress"
    if isinstance(body, frp.Fault):
        return "Fault", header.relates_to
    if is_late(message):
        return "late", header.message_id
    return header.message_id


def is_late(message: Message) -> bool:
    """Whether it is an order that is too late to begin with."""
    return isinstance(message.body, frp.Execute | frp.Compensate) and message.body.begin_by == LAPSED


def key(session: CoordinatorSession | ParticipantSession, matters: Callable[[State, str], bool]) -> object:
    sent_keys = sorted((name, record.id, record.state if name == "Query" else "") for name, record in session.sent_messages.items())
    received_keys = sorted((name, record.id) for name, record in session.received_messages.items() if matters(session.state, name))
    return session.state, tuple(sent_keys), tuple(received_keys)


S = TypeVar("S")


@dataclass
class Side(ABC, Generic[S]):
    """The states of one side by number, and what comes of each once it was worked out."""

    inbox: MessageTable
    outbox: MessageTable
    futures: Futures
    states: list[S] = field(default_factory=list)
    _numbers: dict[object, int] = field(default_factory=dict)
    reactions: dict[tuple[int, int], Action] = field(default_factory=dict)
    """What came of each message in each state in which it arrived."""
    _actions: dict[int, tuple[Action, ...]] = field(default_factory=dict)

    def _number(self, key: object, state: S) -> int:
        if key not in self._numbers:
            self._numbers[key] = len(self.states)
            self.states.append(state)
        return self._numbers[key]

    def receive(self, state_number: int, token: int) -> Action:
        """What comes of hearing it."""
        if (state_number, token) not in self.reactions:
            description = f"hears {'late ' if is_late(self.inbox.messages[token]) else ''}{self.inbox.name(token)}"
            self.reactions[state_number, token] = try_action(
                lambda: self._receive(state_number, token, description), description, state_number
            )
        return self.reactions[state_number, token]

    def actions(self, state_number: int) -> tuple[Action, ...]:
        """What it may do of its own accord."""
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
        """The messages' numbers, and what is wrong with them."""
        numbers = tuple(self.outbox.number(message, session.number) for message in messages)
        fault = next((message.body.text for message in messages if isinstance(message.body, frp.Fault)), "")
        return numbers, f"a message does not fit: {fault}" if fault else ""


def try_action(action: Callable[[], Action], description: str, state_number: int) -> Action:
    """A step as the session takes it. One that it cannot take is what a wrong table comes to."""
    try:
        return action()
    except (UsageError, KeyError, AssertionError) as error:
        return Action(description, state_number, wrong=f"{description}: {error}")


def forget_fleeting(session: ParticipantSession | CoordinatorSession) -> None:
    """Signs of life are all the same; that keeps the states finite."""
    session.sent_messages = {name: record for name, record in session.sent_messages.items() if name not in FLEETING or name == "Query"}

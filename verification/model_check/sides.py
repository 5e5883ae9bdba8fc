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


class Step(NamedTuple):
    """Something that a side does or hears. `joint` names the rule of the transaction that it is subject to, if it is."""

    what: str
    after: int
    says: tuple[int, ...] = ()
    fair: Fair = Fair.NO
    joint: str = ""
    wrong: str = ""
    """Why this must never happen."""


class Post:
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

    def ready(self, session: CoordinatorSession | ParticipantSession, kind: type[object] | None) -> None:
        """Have the session count the messages of each type apart. Messages of one type are told apart as before, and
        what was said before it does not make it another message."""
        before = session.sent_messages.get(kind.__name__) if kind is not None else None
        session.number = self._count.get(before.id, 0) if before is not None else 0

    def lapsed(self, token: int) -> int:
        """The same message, too late to begin with; itself when it is no order, or is too late already."""
        message = self.messages[token]
        if not isinstance(message.body, frp.Execute | frp.Compensate) or is_late(message):
            return token
        late = structs.replace(message, body=structs.replace(message.body, begin_by=LAPSED))
        return self.number(late, self._count[message.header.message_id])

    def ready_again(self, session: CoordinatorSession, kind: type[object]) -> None:
        """As `ready`, to say the same again under the same number: to whoever hears it, both mean the same."""
        self.ready(session, kind)
        session.number -= 1

    def name(self, token: int) -> str:
        return type(self.messages[token].body).__name__

    def of(self, kinds: frozenset[type[object]]) -> int:
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
    said = sorted((name, one.id, one.state if name == "Query" else "") for name, one in session.sent_messages.items())
    heard = sorted((name, one.id) for name, one in session.received_messages.items() if matters(session.state, name))
    return session.state, tuple(said), tuple(heard)


S = TypeVar("S")


@dataclass
class Side(ABC, Generic[S]):
    """The states of one side by number, and what comes of each once it was worked out."""

    hears: Post
    says: Post
    futures: Futures
    states: list[S] = field(default_factory=list)
    _numbers: dict[object, int] = field(default_factory=dict)
    heard: dict[tuple[int, int], Step] = field(default_factory=dict)
    """What came of each message in each state in which it arrived."""
    _moves: dict[int, tuple[Step, ...]] = field(default_factory=dict)

    def _number(self, key: object, state: S) -> int:
        if key not in self._numbers:
            self._numbers[key] = len(self.states)
            self.states.append(state)
        return self._numbers[key]

    def receive(self, at: int, token: int) -> Step:
        """What comes of hearing it."""
        if (at, token) not in self.heard:
            what = f"hears {'late ' if is_late(self.hears.messages[token]) else ''}{self.hears.name(token)}"
            self.heard[at, token] = trial(lambda: self._receive(at, token, what), what, at)
        return self.heard[at, token]

    def moves(self, at: int) -> tuple[Step, ...]:
        """What it may do of its own accord."""
        if at not in self._moves:
            self._moves[at] = tuple(self._all_moves(at))
        return self._moves[at]

    @abstractmethod
    def _receive(self, at: int, token: int, what: str) -> Step: ...

    @abstractmethod
    def _all_moves(self, at: int) -> Iterator[Step]: ...

    def _spoken(self, session: CoordinatorSession | ParticipantSession, messages: tuple[Message, ...]) -> tuple[tuple[int, ...], str]:
        """The messages' numbers, and what is wrong with them."""
        numbers = tuple(self.says.number(message, session.number) for message in messages)
        fault = next((message.body.text for message in messages if isinstance(message.body, frp.Fault)), "")
        return numbers, f"a message does not fit: {fault}" if fault else ""


def trial(step: Callable[[], Step], what: str, at: int) -> Step:
    """A step as the session takes it. One that it cannot take is what a wrong table comes to."""
    try:
        return step()
    except (UsageError, KeyError, AssertionError) as error:
        return Step(what, at, wrong=f"{what}: {error}")


def forget_fleeting(session: ParticipantSession | CoordinatorSession) -> None:
    """Signs of life are all the same; that keeps the states finite."""
    session.sent_messages = {name: one for name, one in session.sent_messages.items() if name not in FLEETING or name == "Query"}

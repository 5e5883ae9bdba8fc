"""The one signature that joins all parts: `handle(input, now) -> effects`.

A component reads no clock and does no I/O. Its node (`runtime.node`) feeds it inputs and carries the effects out in order. Where inputs
are kept, they are on disk, with what is recorded of them, before anything else that comes of them is seen. Timers, questions and answers
are values of the component's own types: Structs, which can be compared, hashed and written down.
"""

from __future__ import annotations

from collections.abc import Generator, Hashable
from typing import Any, Protocol, TypeVar

from msgspec import Struct

from somrs.protocol.messages.envelope import Message

T = TypeVar("T")


class Received(Struct, frozen=True, tag=True):
    """A message came."""

    message: Message


class TimerFired(Struct, frozen=True, tag="Rang"):
    """A timer that the component set with `SetTimer` rang."""

    timer: Hashable


class Answered(Struct, frozen=True, tag=True):
    """The answer to an earlier `Ask`; `value` is what the asked one returns, the exception it raised, or a `PartialAnswer` on the way."""

    question: Hashable
    value: object


class ErrorAnswer(Struct, frozen=True, tag="Trouble"):
    """What went wrong, where a question is answered from or into a journal: there, exceptions are no values."""

    text: str

    def __str__(self) -> str:
        return self.text


class PartialAnswer(Struct, frozen=True):
    """What answers on the way are derived from: the question stays open, and its answer is yet to come."""


class AnswerLost(Struct, frozen=True, tag="Lost"):
    """The answer to a question whose work ended with the process that did it. Which kinds of work do, the component's schema says."""


class Notified(Struct, frozen=True, tag=True):
    """The program around the component tells it something: a value of the component's own."""

    notice: object


class DeliveryFailed(Struct, frozen=True, tag="Undelivered"):
    """A message that nobody acknowledged until its sender gave up."""

    message: Message
    reason: str


class Started(Struct, frozen=True, tag=True):
    """The node is up at `address`: the first input of every component."""

    address: str


Input = Started | Received | TimerFired | Answered | DeliveryFailed | Notified


class Send(Struct, frozen=True):
    """Send this, again and again until the recipient's node acknowledges it or `expires_at` (seconds, the node's clock). After a restart it
    is sent for some more seconds, as nobody could take it meanwhile; but not if `strict`: later than that it would be wrong."""

    message: Message
    expires_at: float | None = None
    strict: bool = False


class SetTimer(Struct, frozen=True):
    """Ring `timer` at `at`; an equal timer that has not rung is moved. `at` None takes it away."""

    timer: Hashable
    at: float | None


class Ask(Struct, frozen=True):
    """Have something done that takes time or I/O: `task` is a value that the node knows how to carry out (a planning
    problem, a device's service, a history to be read). Its result comes back as `Answered(question, ...)`."""

    question: Hashable
    task: object


class Withdraw(Struct, frozen=True):
    """Stop working on an earlier `Ask`. It is answered all the same, with what it came to."""

    question: Hashable


class Record(Struct, frozen=True):
    """Have this in the archive of the component's journal, if it has one; nothing else of this input leaves before it is there."""

    entry: object


Effect = Send | SetTimer | Ask | Withdraw | Record

Effects = Generator[Effect, None, None]
"""What a component's parts do about an input: effects as they come. Nothing happens before somebody goes through them."""

EffectsReturning = Generator[Effect, None, T]
"""Effects, and at their end a result: `result = yield from doing`."""


class Component(Protocol):
    """A Task Manager, Service Manager, Registry, Repository or Scheduler, without its I/O."""

    def handle(self, event: Input, now: float) -> list[Effect]:
        """What to do about the input. `now` is in seconds and never goes back."""
        ...


class Stateful(Component, Protocol):
    """A component whose inputs are kept in a journal: what it knows is one tree of data, of the type that its schema names."""

    @property
    def state(self) -> Any: ...

    @property
    def open(self) -> list[str]:
        """What it has not finished, for people."""
        ...

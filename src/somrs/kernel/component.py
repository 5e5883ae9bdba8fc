"""The interface of all components: `handle(input, now) -> effects`.

A component reads no clock and does no I/O. Its node (`runtime.node`) passes inputs to it and carries out the effects in order. A node with
a journal writes each input and its records to disk before any other effect of the input becomes visible. Timers, questions and answers are
values of the component's own types: Structs, which can be compared, hashed and serialized.
"""

from __future__ import annotations

from collections.abc import Generator, Hashable
from typing import Any, Protocol, TypeVar

from msgspec import Struct

from somrs.protocol.messages.envelope import Message

T = TypeVar("T")


class Received(Struct, frozen=True, tag=True):
    """A message arrived."""

    message: Message


class TimerFired(Struct, frozen=True, tag="Rang"):
    """A timer that the component set with `SetTimer` fired."""

    timer: Hashable


class Answered(Struct, frozen=True, tag=True):
    """The answer to an earlier `Ask`; `value` is the result, the exception that was raised, or a `PartialAnswer` before the result."""

    question: Hashable
    value: object


class ErrorAnswer(Struct, frozen=True, tag="Trouble"):
    """An error as an answer: a journal cannot hold exceptions."""

    text: str

    def __str__(self) -> str:
        return self.text


class PartialAnswer(Struct, frozen=True):
    """Base class of intermediate answers: the question stays open until its final answer arrives."""


class AnswerLost(Struct, frozen=True, tag="Lost"):
    """The answer to a question whose work was lost with its process; `Schema.volatile` lists the types of such work."""


class Notified(Struct, frozen=True, tag=True):
    """The program around the component passes it a value of one of the component's own types."""

    notice: object


class DeliveryFailed(Struct, frozen=True, tag="Undelivered"):
    """The sender gave up on a message because the recipient did not acknowledge it."""

    message: Message
    reason: str


class Started(Struct, frozen=True, tag=True):
    """The node is running at `address`: the first input of every component."""

    address: str


Input = Started | Received | TimerFired | Answered | DeliveryFailed | Notified


class Send(Struct, frozen=True):
    """Send the message repeatedly until the recipient's node acknowledges it or `expires_at` is reached (seconds, the node's clock).

    After a restart, the node extends the limit by some seconds, because it sent nothing while it was down. It does not extend a `strict`
    limit: a later delivery would be wrong.
    """

    message: Message
    expires_at: float | None = None
    strict: bool = False


class SetTimer(Struct, frozen=True):
    """Set `timer` to fire at `at` (seconds). A pending equal timer is moved; `at` None cancels it."""

    timer: Hashable
    at: float | None


class Ask(Struct, frozen=True):
    """Start work that takes time or I/O. The result arrives as `Answered(question, ...)`.

    `task` is a value that the node can carry out: a planning problem, a device's service, a query of the history.
    """

    question: Hashable
    task: object


class Withdraw(Struct, frozen=True):
    """Stop the work on an earlier `Ask`. Its answer still arrives, with the result so far."""

    question: Hashable


class Record(Struct, frozen=True):
    """Store `entry` in the archive of the component's journal, if it has one, before any other effect of the same input is visible."""

    entry: object


Effect = Send | SetTimer | Ask | Withdraw | Record

Effects = Generator[Effect, None, None]
"""The effects of an input as a generator. Its code runs only while a caller iterates over it."""

EffectsReturning = Generator[Effect, None, T]
"""Effects, followed by a result: `result = yield from effects`."""


class Component(Protocol):
    """A Task Manager, Service Manager, Registry, Repository or Scheduler, without its I/O."""

    def handle(self, event: Input, now: float) -> list[Effect]:
        """Handle an input and return its effects. `now` is in seconds and never decreases."""
        ...


class Stateful(Component, Protocol):
    """A component with a journal. Its state is one tree of data, of the type that its schema names."""

    @property
    def state(self) -> Any: ...

    @property
    def open(self) -> list[str]:
        """The names of unfinished work, for people."""
        ...

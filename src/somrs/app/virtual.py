"""A whole system in one process on virtual time: the rim without sockets, disks or waiting. What takes an hour takes none.

The same components run here as in `node.py`; only who carries their effects out is another.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterator

from somrs.errors import RemoteError
from somrs.protocol.component import (
    Answered,
    Ask,
    Component,
    Effect,
    Input,
    Rang,
    Received,
    Record,
    Send,
    Started,
    Undelivered,
    Wake,
    Withdraw,
)
from somrs.protocol.envelope import Message

LATENCY = 0.001
"""Seconds that a message takes."""

DELIVERY_TIME = 30.0
"""Seconds after which a message to nobody is given up, as in `node.py`."""

Work = Iterator[tuple[float, object]]
"""What an `Ask` comes to: pairs of seconds and the value reported then; the last is the result."""

CarryOut = Callable[[object], Work]


def at_once(answer: Callable[[object], object]) -> CarryOut:
    """Work that takes no time; what it raises is its answer."""

    def work(task: object) -> Work:
        try:
            yield 0.0, answer(task)
        except Exception as error:  # noqa: BLE001  # the component says what it means, as in node.py
            yield 0.0, error

    return work


def _cannot(task: object) -> object:
    raise RemoteError(f"nobody here can do {type(task).__name__}")


class World:
    """Components at their addresses, the messages between them, and the time."""

    def __init__(self, start: float = 1_000_000.0) -> None:
        self.now = start
        self.messages: list[Message] = []
        """Every message that was sent, in order; a delivery that is tried again counts once."""
        self.components: dict[str, Component] = {}
        self.records: dict[str, list[object]] = {}
        self._carry_out: dict[str, CarryOut] = {}
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._count = itertools.count()
        self._timers: dict[tuple[str, str], int] = {}
        self._work: dict[tuple[str, str], int] = {}

    def add(self, address: str, component: Component, carry_out: CarryOut | None = None) -> None:
        """Put a component at an address and start it."""
        self.components[address] = component
        self.records[address] = []
        self._carry_out[address] = carry_out or at_once(_cannot)
        self._feed(address, Started(address))

    def remove(self, address: str) -> None:
        """It is gone, without a word."""
        self.components.pop(address, None)

    def send(self, message: Message) -> None:
        """Send a message from outside."""
        self._post(message, self.now + DELIVERY_TIME, first=True)

    def run(self, seconds: float = 3600.0, until: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass until the condition holds (True), or for so long, or until nothing is left to happen."""
        end = self.now + seconds
        while not until():
            if not self._events or self._events[0][0] > end:
                self.now = end
                return until()
            self.now, _, happen = heapq.heappop(self._events)
            happen()
        return True

    def _at(self, when: float, happen: Callable[[], None]) -> None:
        heapq.heappush(self._events, (max(when, self.now), next(self._count), happen))

    def _feed(self, address: str, event: Input) -> None:
        if (component := self.components.get(address)) is not None:
            for effect in component.handle(event, self.now):
                self._do(address, effect)

    def _do(self, address: str, effect: Effect) -> None:
        match effect:
            case Send(message, until):
                self._post(message, until if until is not None else self.now + DELIVERY_TIME, first=True)
            case Wake(timer, at):
                serial = self._timers[address, timer] = next(self._count)
                if at is not None:
                    self._at(at, lambda: self._ring(address, timer, serial))
            case Ask(question, task):
                serial = self._work[address, question] = next(self._count)
                self._continue(address, question, serial, self._carry_out[address](task))
            case Withdraw(question):
                if self._work.pop((address, question), None) is not None:
                    self._at(self.now, lambda: self._feed(address, Answered(question, RemoteError("withdrawn"))))
            case Record(entry):
                self.records[address].append(entry)

    def _ring(self, address: str, timer: str, serial: int) -> None:
        if self._timers.get((address, timer)) == serial:
            del self._timers[address, timer]
            self._feed(address, Rang(timer))

    def _continue(self, address: str, question: str, serial: int, work: Work) -> None:
        step = next(work, None)
        if step is None:
            return
        seconds, value = step

        def come() -> None:
            if self._work.get((address, question)) == serial:
                self._feed(address, Answered(question, value))
                self._continue(address, question, serial, work)

        self._at(self.now + seconds, come)

    def _post(self, message: Message, until: float, *, first: bool = False) -> None:
        if first:
            self.messages.append(message)
        recipient, sender = message.header.recipient, message.header.sender
        if recipient in self.components:
            self._at(self.now + LATENCY, lambda: self._feed(recipient, Received(message)))
        elif self.now < until:
            self._at(min(until, self.now + 1.0), lambda: self._post(message, until))
        else:
            self._feed(sender, Undelivered(message, "nobody is there"))

"""A whole system in one process on virtual time: the rim without sockets, disks or waiting. What takes an hour takes none.

The same components run here as in `node.py`; only who carries their effects out is another.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

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


Medium = Callable[[Message], Sequence[float]]
"""The seconds that a message takes: more than one for a message that comes again, as it may."""

Watch = Callable[[str, Input], None]
"""Sees each input, and whose it was, when its effects have been carried out."""


@dataclass(frozen=True, slots=True, eq=False)
class _Parked:
    """A message whose recipient cannot be reached."""

    message: Message
    until: float


def promptly(message: Message) -> Sequence[float]:
    """Nothing is late, and nothing comes twice."""
    return (LATENCY,)


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

    def __init__(self, start: float = 1_000_000.0, *, medium: Medium = promptly, watch: Watch = lambda address, event: None) -> None:
        self.now = start
        self.messages: list[Message] = []
        """Every message that was sent, in order; a delivery that is tried again counts once."""
        self.components: dict[str, Component] = {}
        self.records: dict[str, list[object]] = {}
        self._medium, self._watch = medium, watch
        self._carry_out: dict[str, CarryOut] = {}
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._count = itertools.count()
        self._timers: dict[tuple[str, str], int] = {}
        self._work: dict[tuple[str, str], int] = {}
        self._parked: list[_Parked] = []
        self._cut_off: set[str] = set()

    def add(self, address: str, component: Component, carry_out: CarryOut | None = None) -> None:
        """Put a component at an address and start it."""
        self.components[address] = component
        self.records[address] = []
        self._carry_out[address] = carry_out or at_once(_cannot)
        self._feed(address, Started(address))
        self._deliver_parked()

    def remove(self, address: str) -> None:
        """It is gone, without a word, and whatever it had under way with it."""
        self.components.pop(address, None)
        for kept in (self._timers, self._work):
            for key in [key for key in kept if key[0] == address]:
                del kept[key]

    def ring(self, address: str, timer: str) -> None:
        """Ring a timer that is rung from outside."""
        self._feed(address, Rang(timer))

    def cut_off(self, address: str) -> None:
        """It goes on, but nothing reaches it, and nothing that it sends arrives."""
        self._cut_off.add(address)

    def reconnect(self, address: str) -> None:
        self._cut_off.discard(address)
        self._deliver_parked()

    def timers(self, address: str) -> set[str]:
        """The timers of a component that have yet to ring."""
        return {timer for owner, timer in self._timers if owner == address}

    def send(self, message: Message) -> None:
        """Send a message from outside."""
        self._post(message, self.now + DELIVERY_TIME)

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
            self._watch(address, event)

    def _do(self, address: str, effect: Effect) -> None:
        match effect:
            case Send(message, until):
                self._post(message, until if until is not None else self.now + DELIVERY_TIME)
            case Wake(timer, at):
                self._timers.pop((address, timer), None)
                if at is not None:
                    serial = self._timers[address, timer] = next(self._count)
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

    def _post(self, message: Message, until: float) -> None:
        self.messages.append(message)
        first, *again = self._medium(message)
        self._at(self.now + first, partial(self._arrive, _Parked(message, until)))
        for late in again:
            self._at(self.now + late, partial(self._arrive, _Parked(message, until), again=True))

    def _arrive(self, sent: _Parked, *, again: bool = False) -> None:
        """At its recipient; or it waits for it until its time is over. A second copy does not wait."""
        if self._reaches(sent.message):
            self._feed(sent.message.header.recipient, Received(sent.message))
        elif not again:
            self._parked.append(sent)
            self._at(sent.until, lambda: self._give_up(sent))

    def _reaches(self, message: Message) -> bool:
        sender, recipient = message.header.sender, message.header.recipient
        return recipient in self.components and not self._cut_off & {sender, recipient}

    def _deliver_parked(self) -> None:
        parked, self._parked = self._parked, []
        for sent in parked:
            if self._reaches(sent.message):
                self._at(self.now + LATENCY, partial(self._arrive, sent))
            else:
                self._parked.append(sent)

    def _give_up(self, sent: _Parked) -> None:
        if sent in self._parked:
            self._parked.remove(sent)
            self._feed(sent.message.header.sender, Undelivered(sent.message, "nobody is there"))

"""Messages on virtual time: each arrives after the delays of the medium, or is sent again until it arrives or expires."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from somrs.kernel.component import DeliveryFailed, Input, Received
from somrs.kernel.durability import DELIVERY_TIME, FIRST_PAUSE, LONGEST_PAUSE, JournaledComponent
from somrs.protocol.messages.envelope import Message
from somrs.runtime.virtual_clock import VirtualClock

LATENCY = 0.001
"""Seconds until a message arrives."""

Medium = Callable[[Message], Sequence[float]]
"""Returns the seconds until each copy of a message arrives: several for a repeated message, none for a lost one.

A lost message is sent again after a pause, until it expires.
"""


@dataclass(slots=True, eq=False)
class Sender:
    """A component from one start to its end, as a sender of messages."""

    address: str
    journaled: JournaledComponent | None


@dataclass(slots=True, eq=False)
class _Transmission:
    """A message under way. `sender` repeats it until `deadline`, and knows it by its number; None: it is from outside."""

    message: Message
    deadline: float
    sender: Sender | None = None
    number: int = 0
    pause: float = FIRST_PAUSE
    waiting: bool = False
    """No copy is under way: the message waits for its recipient, or to be sent again."""
    is_settled: bool = False
    """The message was acknowledged, or it expired."""


def promptly(message: Message) -> Sequence[float]:
    """A medium without delays, repetitions and losses."""
    return (LATENCY,)


class VirtualNetwork:
    """The messages between components. `senders`: the components that are alive, by their addresses.

    `deliver` lets the component at an address handle an input, and returns whether the input is acknowledged.
    """

    def __init__(self, clock: VirtualClock, medium: Medium, senders: Mapping[str, Sender], deliver: Callable[[str, Input], bool]) -> None:
        self.messages: list[Message] = []
        """Every message that was sent, in order; repetitions are not counted."""
        self._clock, self._medium, self._senders, self._deliver = clock, medium, senders, deliver
        self._parked: list[_Transmission] = []
        self._cut_off: set[str] = set()
        self._separated: Counter[frozenset[str]] = Counter()
        self._replaced: set[Sender] = set()
        self._posted: set[str] = set()

    def send(self, message: Message, expires_at: float | None = None, sender: Sender | None = None, number: int = 0) -> None:
        """Send a message of a component, of which it is this number, or from outside."""
        self._posted.add(message.header.message_id)
        self.messages.append(message)
        self._transmit(_Transmission(message, expires_at if expires_at is not None else self._clock.now + DELIVERY_TIME, sender, number))

    def resume(self, message: Message, expires_at: float, sender: Sender, number: int) -> None:
        """Send a message again that was under way when its sender was killed."""
        transmission = _Transmission(message, expires_at, sender, number)
        transmission.waiting = overdue = transmission.deadline <= self._clock.now
        if not overdue and message.header.message_id not in self._posted:  # it was not counted before the kill
            self._posted.add(message.header.message_id)
            self.messages.append(message)
        self._clock.schedule(self._clock.now, partial(self._expire if overdue else self._transmit, transmission))

    def abandon(self, sender: Sender) -> None:
        """Forget the messages of a component that has ended, as far as they wait for their recipients."""
        if sender not in self._replaced:
            self._forget(sender)

    def _forget(self, sender: Sender) -> None:
        self._parked = [transmission for transmission in self._parked if transmission.sender is not sender]

    def cut_off(self, address: str) -> None:
        """Disconnect the component: no message reaches it or arrives from it."""
        self._cut_off.add(address)

    def reconnect(self, address: str) -> None:
        self._cut_off.discard(address)
        self.deliver_parked()

    def separate(self, address: str, other_address: str) -> None:
        """Let no message pass between two components. They are joined when `join` was called as often."""
        self._separated[frozenset((address, other_address))] += 1

    def join(self, address: str, other_address: str) -> None:
        self._separated[frozenset((address, other_address))] -= 1
        self.deliver_parked()

    def linger(self, sender: Sender, seconds: float) -> None:
        """A component that another process continues goes on sending for so long what it had under way."""
        self._replaced.add(sender)
        self._clock.schedule(self._clock.now + seconds, partial(self._end_lingering, sender))

    def _end_lingering(self, sender: Sender) -> None:
        self._replaced.discard(sender)
        self._forget(sender)

    def _transmit(self, transmission: _Transmission) -> None:
        """Send the message, for the first time or again."""
        if self._abandoned(transmission):
            return
        transmission.waiting = False
        times = self._medium(transmission.message)
        for delay in times:
            self._clock.schedule(self._clock.now + delay, partial(self._arrive, transmission))
        if not times:
            transmission.waiting = True
            retry_time = self._clock.now + transmission.pause
            transmission.pause = min(transmission.pause * 2, LONGEST_PAUSE)
            self._clock.schedule(
                min(retry_time, transmission.deadline),
                partial(self._transmit if retry_time < transmission.deadline else self._expire, transmission),
            )

    def _arrive(self, transmission: _Transmission) -> None:
        """Deliver the message to its recipient; otherwise its sender repeats it until it arrives or expires."""
        if self._reaches(transmission.message) and self._deliver(transmission.message.header.recipient, Received(transmission.message)):
            if not transmission.is_settled:
                self._settle(transmission)
        elif not (transmission.is_settled or transmission.waiting or self._abandoned(transmission)):
            transmission.waiting = True
            self._parked.append(transmission)
            self._clock.schedule(transmission.deadline, partial(self._expire, transmission))

    def _reaches(self, message: Message) -> bool:
        sender, recipient = message.header.sender, message.header.recipient
        is_separated = self._separated[frozenset((sender, recipient))] > 0
        return recipient in self._senders and not is_separated and not self._cut_off & {sender, recipient}

    def _abandoned(self, transmission: _Transmission) -> bool:
        """Whether the sender was killed, so that the message is not repeated. A copy under way may still arrive."""
        sender = transmission.sender
        return sender is not None and sender not in self._replaced and self._senders.get(sender.address) is not sender

    def _settle(self, transmission: _Transmission) -> None:
        transmission.is_settled, transmission.waiting = True, False
        if transmission.sender is not None and transmission.sender.journaled is not None and not self._abandoned(transmission):
            transmission.sender.journaled.mark_delivered(transmission.number)

    def deliver_parked(self) -> None:
        """Deliver the messages that wait for recipients that are there now."""
        parked, self._parked = self._parked, []
        for transmission in parked:
            if self._reaches(transmission.message):
                transmission.waiting = False
                self._clock.schedule(self._clock.now + LATENCY, partial(self._arrive, transmission))
            else:
                self._parked.append(transmission)

    def _expire(self, transmission: _Transmission) -> None:
        if not transmission.waiting or self._abandoned(transmission):
            return
        if transmission in self._parked:
            self._parked.remove(transmission)
        if transmission.sender in self._replaced:
            return  # it cannot write down that its message has expired
        self._settle(transmission)
        self._deliver(
            transmission.sender.address if transmission.sender is not None else transmission.message.header.sender,
            DeliveryFailed(transmission.message, "there is no component at the address"),
        )

"""The five media of Ravn, Srba, Vighio and Marques, each with senders that repeat messages until they are acknowledged.

A channel leads from one side to the other, and holds tokens: small numbers that stand for messages. Equal messages have equal tokens. The
receiver acknowledges a message once it is in its journal; the acknowledgement can be lost.

No medium holds two copies of one message at a time, except the duplicating one: there, a message that was sent can arrive at any time and
any number of times. It can deliver whatever the other media can, so it also covers several copies on those.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple


class Channel(NamedTuple):
    """The messages in transit in one direction. The bit masks: `unacknowledged` messages are sent again; `copies` may arrive."""

    queue: tuple[int, ...] = ()
    unacknowledged: int = 0
    copies: int = 0


EMPTY = Channel()


class Arrival(NamedTuple):
    """A token that can arrive now, the channel after the arrival, and whether the sender repeats the message until it arrives."""

    token: int
    channel_after: Channel
    is_repeated: bool


class Event(NamedTuple):
    """A step of the medium or of the sender's node: a token is lost, sent again or out of time. `is_repeated` as for an arrival."""

    word: str
    token: int
    channel_after: Channel
    is_repeated: bool


def members(mask: int) -> Iterator[int]:
    """Yield the tokens in a bit mask."""
    while mask:
        low = mask & -mask
        yield low.bit_length() - 1
        mask ^= low


@dataclass(frozen=True, kw_only=True)
class Medium:
    """A kind of channel. An ordered lossy medium puts a repeated message behind the others.

    In an unordered lossy medium, a message without an acknowledgement can arrive at any time, and a lost acknowledgement lets it arrive
    again. Loss and delay are the same there, as a lost message is sent again.
    """

    name: str
    ordered: bool
    lossy: bool
    duplicating: bool = False
    oldest_first: bool = False
    """Ordered and lossy only: the sender repeats its oldest message until it is acknowledged or out of time, and then the next."""

    def __str__(self) -> str:
        return self.name

    @property
    def reliable(self) -> bool:
        """Whether every message arrives once."""
        return not self.lossy

    def send(self, channel: Channel, token: int) -> Channel:
        """Return the channel after the token was sent, for the first time or again."""
        queue, unacknowledged, copies = channel
        bit = 1 << token
        if self.ordered:
            queue = queue if token in queue else (*queue, token)
        elif self.duplicating or not self.lossy:
            copies |= bit
        return Channel(queue, unacknowledged | bit if self.lossy and not self.oldest_first else 0, copies)

    def arrivals(self, channel: Channel) -> Iterator[Arrival]:
        """Yield what can arrive next."""
        queue, unacknowledged, copies = channel
        if self.ordered:
            if queue:
                token, rest = queue[0], queue[1:]
                if self.oldest_first:
                    yield Arrival(token, Channel(rest), True)
                    yield Arrival(token, channel, True)  # its acknowledgement is lost
                    return
                is_repeated = not self.lossy or bool(unacknowledged >> token & 1)
                yield Arrival(token, Channel(rest, unacknowledged & ~(1 << token), 0), is_repeated)
                if self.lossy and is_repeated:  # its acknowledgement is lost
                    yield Arrival(token, Channel(rest, unacknowledged, 0), is_repeated)
        elif self.duplicating:
            for token in members(copies):
                yield Arrival(token, Channel((), unacknowledged & ~(1 << token), copies), bool(unacknowledged >> token & 1))
        elif self.lossy:
            for token in members(unacknowledged):
                yield Arrival(token, Channel((), unacknowledged & ~(1 << token), 0), True)
                yield Arrival(token, channel, True)  # its acknowledgement is lost
        else:
            for token in members(copies):
                yield Arrival(token, Channel((), 0, copies & ~(1 << token)), True)

    def events(self, channel: Channel) -> Iterator[Event]:
        """Yield the medium's own steps. An unordered medium has none: `arrivals` covers them."""
        queue, unacknowledged, _ = channel
        if self.oldest_first:
            if queue:
                yield Event("is out of time", queue[0], Channel(queue[1:]), True)
        elif self.ordered and self.lossy:
            for place, token in enumerate(queue):
                rest = Channel(queue[:place] + queue[place + 1 :], unacknowledged, 0)
                yield Event("is lost", token, rest, bool(unacknowledged >> token & 1))
            for token in members(unacknowledged):
                if token not in queue:
                    yield Event("is sent again", token, Channel((*queue, token), unacknowledged, 0), True)

    def drop(self, channel: Channel, tokens: int) -> Channel:
        """Return the channel without these tokens."""
        queue, unacknowledged, copies = channel
        return Channel(tuple(token for token in queue if not tokens >> token & 1), unacknowledged & ~tokens, copies & ~tokens)

    def lapsed(self, channel: Channel, order: int, late: int) -> Channel:
        """Return the channel after the order has expired: it is not sent again, and copies in transit are late."""
        queue, unacknowledged, copies = channel
        queue = tuple(late if token == order else token for token in queue if token != late)
        waiting_bit, copy_bit = unacknowledged >> order & 1, copies >> order & 1
        unacknowledged &= ~(1 << order)
        if waiting_bit and not self.ordered and not self.duplicating:
            unacknowledged |= 1 << late  # on this medium the bit means that the message is in transit
        return Channel(queue, unacknowledged, copies & ~(1 << order) | copy_bit << late)

    def restarted(self, channel: Channel) -> tuple[Channel, ...]:
        """Return what a restart of the sender can leave: the node's unsent messages are lost, and messages in transit can arrive."""
        if self.ordered or not self.lossy:
            return Channel(channel.queue, 0, channel.copies), EMPTY
        return (Channel((), 0, channel.copies),) if self.duplicating else (channel, EMPTY)


FIFO = Medium(name="FIFO", ordered=True, lossy=False)
LOSSY_FIFO = Medium(name="FIFO, lossy", ordered=True, lossy=True)
OUTBOX = Medium(name="FIFO, lossy", ordered=True, lossy=True, oldest_first=True)
"""A lossy FIFO with the sending order of `runtime.node`. With repeats in any order, two participants have too many states."""
UNORDERED = Medium(name="unordered", ordered=False, lossy=False)
UNORDERED_LOSSY = Medium(name="unordered, lossy", ordered=False, lossy=True)
DUPLICATING = Medium(name="unordered, lossy, duplicating", ordered=False, lossy=True, duplicating=True)

MEDIA = (FIFO, LOSSY_FIFO, UNORDERED, UNORDERED_LOSSY, DUPLICATING)

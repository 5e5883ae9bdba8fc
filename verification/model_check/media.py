"""The five media of Ravn, Srba, Vighio and Marques, each with senders that repeat what was not acknowledged.

A channel leads from one side to the other and holds tokens, small numbers that stand for messages; the same message is the same
token. A message is acknowledged once the receiver has it in its journal, and an acknowledgement may be lost, too.

No medium holds two copies of one message at a time, but for the duplicating one, in which a message once sent may arrive at any
time and any number of times. Whatever another medium delivers, it can deliver as well, so it speaks for more copies elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple


class Channel(NamedTuple):
    """What is under way in one direction. `unacknowledged` is what the sender would send again; both sets are bit masks."""

    queue: tuple[int, ...] = ()
    unacknowledged: int = 0
    copies: int = 0


EMPTY = Channel()


class Arrival(NamedTuple):
    """A token that can arrive now, the channel then, and whether its sender repeats it until it arrives."""

    token: int
    channel_after: Channel
    is_repeated: bool


class Event(NamedTuple):
    """What a medium, or the sender's node, does by itself: a token is lost, or sent again. `is_repeated` as for an arrival."""

    word: str
    token: int
    channel_after: Channel
    is_repeated: bool


def members(mask: int) -> Iterator[int]:
    """The tokens in a set of them."""
    while mask:
        low = mask & -mask
        yield low.bit_length() - 1
        mask ^= low


@dataclass(frozen=True, kw_only=True)
class Medium:
    """A kind of channel. Ordered and lossy: whatever is sent again comes behind the others.

    Unordered and lossy: a message that is not acknowledged may arrive at any time, and a lost acknowledgement lets it arrive
    again; losing it and delaying it are the same, as it is sent again.
    """

    name: str
    ordered: bool
    lossy: bool
    duplicating: bool = False
    oldest_first: bool = False
    """Ordered and lossy only. The sender repeats its oldest message until it is acknowledged or out of time, and then the next."""

    def __str__(self) -> str:
        return self.name

    @property
    def reliable(self) -> bool:
        """Everything arrives, once."""
        return not self.lossy

    def send(self, channel: Channel, token: int) -> Channel:
        """The sender sends the token, for the first time or again."""
        queue, unacknowledged, copies = channel
        bit = 1 << token
        if self.ordered:
            queue = queue if token in queue else (*queue, token)
        elif self.duplicating or not self.lossy:
            copies |= bit
        return Channel(queue, unacknowledged | bit if self.lossy and not self.oldest_first else 0, copies)

    def arrivals(self, channel: Channel) -> Iterator[Arrival]:
        """What can arrive next."""
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
        """What happens without either side; where order means nothing, `arrivals` has it all."""
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
        """None of these arrives any more."""
        queue, unacknowledged, copies = channel
        return Channel(tuple(token for token in queue if not tokens >> token & 1), unacknowledged & ~tokens, copies & ~tokens)

    def lapsed(self, channel: Channel, order: int, late: int) -> Channel:
        """The order's time is over: it is not sent again, and whatever of it is under way is too late."""
        queue, unacknowledged, copies = channel
        queue = tuple(late if token == order else token for token in queue if token != late)
        waiting_bit, copy_bit = unacknowledged >> order & 1, copies >> order & 1
        unacknowledged &= ~(1 << order)
        if waiting_bit and not self.ordered and not self.duplicating:
            unacknowledged |= 1 << late  # here that means that it is under way
        return Channel(queue, unacknowledged, copies & ~(1 << order) | copy_bit << late)

    def restarted(self, channel: Channel) -> tuple[Channel, ...]:
        """What a restart of the sender leaves: what its node had yet to send is forgotten, what is under way may arrive."""
        if self.ordered or not self.lossy:
            return Channel(channel.queue, 0, channel.copies), EMPTY
        return (Channel((), 0, channel.copies),) if self.duplicating else (channel, EMPTY)


FIFO = Medium(name="FIFO", ordered=True, lossy=False)
LOSSY_FIFO = Medium(name="FIFO, lossy", ordered=True, lossy=True)
OUTBOX = Medium(name="FIFO, lossy", ordered=True, lossy=True, oldest_first=True)
"""A lossy FIFO with the senders that run, see `runtime.node`; with senders that repeat in any order, two participants are too many."""
UNORDERED = Medium(name="unordered", ordered=False, lossy=False)
UNORDERED_LOSSY = Medium(name="unordered, lossy", ordered=False, lossy=True)
DUPLICATING = Medium(name="unordered, lossy, duplicating", ordered=False, lossy=True, duplicating=True)

MEDIA = (FIFO, LOSSY_FIFO, UNORDERED, UNORDERED_LOSSY, DUPLICATING)

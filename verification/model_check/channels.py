"""The states of the channels of one direction, by number, and how they change. Each change is computed once."""

from __future__ import annotations

from somrs.protocol.frp.states import MessageType
from verification.model_check.media import EMPTY, Arrival, Channel, Event, Medium, members
from verification.model_check.sides import MessageTable


class Channels:
    """The states of the channels of one direction, by number."""

    def __init__(self, medium: Medium, post: MessageTable) -> None:
        self.medium, self.messages = medium, post
        self.channels: list[Channel] = [EMPTY]
        self._numbers: dict[Channel, int] = {EMPTY: 0}
        self._send_results: dict[tuple[int, tuple[int, ...]], int] = {}
        self._arrivals: dict[int, tuple[tuple[Arrival, int], ...]] = {}
        self._events: dict[int, tuple[tuple[Event, int], ...]] = {}
        self._lapsed: dict[int, tuple[tuple[Event, int], ...]] = {}
        self._restarted: dict[int, tuple[int, ...]] = {}

    def number(self, channel: Channel) -> int:
        if channel not in self._numbers:
            self._numbers[channel] = len(self.channels)
            self.channels.append(channel)
        return self._numbers[channel]

    def send(self, channel_number: int, tokens: tuple[int, ...]) -> int:
        if not tokens:
            return channel_number
        if (channel_number, tokens) not in self._send_results:
            channel = self.channels[channel_number]
            for token in tokens:
                channel = self.medium.send(channel, token)
            self._send_results[channel_number, tokens] = self.number(channel)
        return self._send_results[channel_number, tokens]

    def arrivals(self, channel_number: int) -> tuple[tuple[Arrival, int], ...]:
        if channel_number not in self._arrivals:
            self._arrivals[channel_number] = tuple(
                (arrival, self.number(arrival.channel_after)) for arrival in self.medium.arrivals(self.channels[channel_number])
            )
        return self._arrivals[channel_number]

    def events(self, channel_number: int) -> tuple[tuple[Event, int], ...]:
        if channel_number not in self._events:
            self._events[channel_number] = tuple(
                (event, self.number(event.channel_after)) for event in self.medium.events(self.channels[channel_number])
            )
        return self._events[channel_number]

    def lapsed(self, channel_number: int) -> tuple[tuple[Event, int], ...]:
        """Return the channels after the expiry of one of the orders in this one."""
        if channel_number not in self._lapsed:
            channel = self.channels[channel_number]
            lapses = []
            for token in {*channel.queue, *members(channel.unacknowledged | channel.copies)}:
                if (late := self.messages.lapsed(token)) != token:
                    lapsed_channel = self.medium.lapsed(channel, token, late)
                    lapses.append((Event("has expired", token, lapsed_channel, False), self.number(lapsed_channel)))
            self._lapsed[channel_number] = tuple(lapses)
        return self._lapsed[channel_number]

    def drop(self, channel_number: int, kinds: frozenset[MessageType]) -> int:
        """Return the channel without messages of these types."""
        return (
            self.number(self.medium.drop(self.channels[channel_number], self.messages.mask_of(kinds)))
            if channel_number and kinds
            else channel_number
        )

    def restarted(self, channel_number: int) -> tuple[int, ...]:
        if channel_number not in self._restarted:
            self._restarted[channel_number] = tuple(
                self.number(channel) for channel in self.medium.restarted(self.channels[channel_number])
            )
        return self._restarted[channel_number]


class ChannelUpdate(dict[int, int]):
    """Maps each channel of one direction to the channel after these messages were sent and the ineffective types dropped. Computed
    once for each channel."""

    def __init__(self, channels: Channels, tokens: tuple[int, ...], ineffective: frozenset[MessageType]) -> None:
        self.channels, self.tokens, self.ineffective = channels, tokens, ineffective

    def __missing__(self, channel_number: int) -> int:
        updated_number = self[channel_number] = self.channels.drop(self.channels.send(channel_number, self.tokens), self.ineffective)
        return updated_number

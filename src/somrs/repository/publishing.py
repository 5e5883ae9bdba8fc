"""Publishes changes of the map and the ontology to subscribers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from somrs.errors import InputError
from somrs.kernel.component import Effects, Send, SetTimer
from somrs.kernel.subscription import Subscription
from somrs.ontology.map import Map
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id, reply
from somrs.protocol.messages.knowledge import MapChanged, MapSubscribed, OntologyChanged, SubscribeMap
from somrs.protocol.messages.leases import grant_lease
from somrs.protocol.messages.neighbours import Neighbour
from somrs.protocol.messages.paging import PAGE_BYTES, size
from somrs.repository.neighbour_view import view_of_news
from somrs.repository.state import Contents, LeasesDue

OWN_OBJECTS = Neighbour(map="", address="", shows_all=True)
"""A reader that is not interested in objects of neighbours: all others are shown."""


@dataclass(frozen=True, slots=True)
class Committed:
    """A change that has been made: what subscribers are told of it, and the map before it."""

    news: MapChanged | OntologyChanged
    map_before: Map


class Publishing:
    """Handles subscriptions. It has no state of its own."""

    def __init__(self, contents: Contents) -> None:
        self._contents = contents

    def start(self, now: float) -> Effects:
        """After a restart, each subscriber receives the current version and reads the changes that it missed."""
        for subscriber in self._contents.subscriptions:
            yield self._notify(subscriber, self._subscribed(subscriber), now)
        yield self._next_expiry()

    def subscribe(self, message: Message, subscribe: SubscribeMap, now: float) -> Effects:
        """Raises InputError for a client without an address."""
        subscriber = message.header.sender
        if subscriber == ANONYMOUS:
            raise InputError("changes can only be sent to a client that has an address: set the sender to one that can be reached")
        self._contents.subscriptions[subscriber] = Subscription(
            until=now + grant_lease(subscribe.lease), version=self._contents.version, own=subscribe.own
        )
        yield Send(reply(message, self._subscribed(subscriber), self._contents.address))
        yield self._next_expiry()

    def publish(self, change: Committed | None, now: float) -> Effects:
        """Tell the subscribers of a change, if there was one. Neighbours are told what they see of it."""
        if change is None:
            return
        contents, news = self._contents, change.news
        # A change that is too large for one message is read by pages: the new version shows the subscriber that it missed a change.
        large = size(news) > PAGE_BYTES * 1.25
        for address, subscription in contents.subscriptions.items():
            if subscription.until > now:
                yield self._notify(address, self._subscribed(address) if large else self._seen(change, address, subscription), now)

    def _seen(self, change: Committed, address: str, subscription: Subscription) -> MapChanged | OntologyChanged:
        """What a subscriber sees of a change."""
        contents = self._contents
        has_foreign_objects = bool(change.map_before.homes or contents.map.homes)
        neighbour = contents.neighbour_at(address)
        reader = neighbour.settings if neighbour is not None else OWN_OBJECTS if subscription.own and has_foreign_objects else None
        if reader is None:
            return change.news
        return view_of_news(change.news, reader, change.map_before, contents.map, contents.ontology)

    def expire(self, now: float) -> Effects:
        """Drop the subscriptions that have expired."""
        subscriptions = self._contents.subscriptions
        yield from self._drop([address for address, subscription in subscriptions.items() if subscription.until <= now])

    def undelivered(self, message: Message) -> Effects:
        """Drop a subscriber that cannot be reached, unless it subscribed again after the message was sent."""
        match message.body:
            case MapChanged(event=event):
                version = event.version
            case OntologyChanged(version=version) | MapSubscribed(version=version):
                pass
            case _:
                return
        subscription = self._contents.subscriptions.get(message.header.recipient)
        if subscription is not None and version > subscription.version:
            yield from self._drop([message.header.recipient])

    def announce(self, subscribers: Iterable[str], now: float) -> Effects:
        """Tell subscribers that they see other places or maps: they ask what they see."""
        for subscriber in subscribers:
            if subscriber in self._contents.subscriptions:
                yield self._notify(subscriber, self._subscribed(subscriber), now)

    def _subscribed(self, subscriber: str) -> MapSubscribed:
        contents = self._contents
        until, neighbour = contents.subscriptions[subscriber].until, contents.neighbour_at(subscriber)
        if neighbour is None:
            return MapSubscribed(version=contents.version, until=until, complete=tuple(sorted(contents.map.complete)))
        if neighbour.settings.shows_all:
            return MapSubscribed(version=contents.version, until=until, complete=(contents.map.name,))
        return MapSubscribed(version=contents.version, until=until, shown=neighbour.settings.shows)

    def _notify(self, subscriber: str, news: MapChanged | OntologyChanged | MapSubscribed, now: float) -> Send:
        kind, address = type(news).__name__, self._contents.address
        identity = message_id(address, subscriber, kind, self._contents.version, now if isinstance(news, MapSubscribed) else "")
        return Send(Message(header=Header(sender=address, recipient=subscriber, message_id=identity), body=news))

    def _drop(self, subscribers: list[str]) -> Effects:
        for subscriber in subscribers:
            del self._contents.subscriptions[subscriber]
        yield self._next_expiry()

    def _next_expiry(self) -> SetTimer:
        return SetTimer(LeasesDue(), min((subscription.until for subscription in self._contents.subscriptions.values()), default=None))

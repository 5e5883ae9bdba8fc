"""A component that follows the Repository, the Registry and the Scheduler, and publishes their changes at the hub."""

from __future__ import annotations

import asyncio

from somrs.api.map_news import MapNews
from somrs.api.service_presence import ServicePresence
from somrs.client.client import Addresses
from somrs.client.hub import Hub
from somrs.kernel.component import Effect, Input, Received, Send, SetTimer, Started, TimerFired
from somrs.kernel.replica import Replica
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import ServicesJoined, ServicesLeft, ServicesSubscribed, SubscribeServices
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.orders import OrdersChanged, OrdersSubscribed, SubscribeOrders

LEASE = 30.0
"""Seconds for which the Registry and the Scheduler are subscribed to."""
RENEWAL_INTERVAL = 10.0
"""Seconds after which the subscriptions are renewed."""
RENEWAL = "services"
"""The name of the timer for the renewal."""


class Listener:
    """Follows the Repository, the Registry and the Scheduler.

    `replica` has the map and the ontology; `ready` is set when they have been read. `presence` has the services on offer, and which
    devices joined and left.
    """

    def __init__(self, address: str, addresses: Addresses, hub: Hub) -> None:
        self.address = address
        self.replica = Replica(address, addresses.repository)
        self.ready = asyncio.Event()
        self.presence = ServicePresence()
        self._registry, self._scheduler = addresses.registry, addresses.scheduler
        self._scheduler_started_at: float | None = None
        self._hub = hub
        self._request_count = 0

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Started):
            return [*self.replica.start(now), *self._subscribe(now)]
        news = self.replica.handle(event, now)
        if news is not None:
            if self.replica.ready:
                self.ready.set()
            if news.ontology_changed:
                self._hub.publish("ontology", self.replica.version)
            if news.changes or news.reloaded:
                self._hub.publish("map", MapNews(version=self.replica.version, changes=news.changes, read=news.reloaded))
            return news.effects
        match event:
            case TimerFired(timer) if timer == RENEWAL:
                return self._subscribe(now)
            case Received(Message(body=ServicesJoined() | ServicesLeft() as body)):
                self.presence.handle_news(body)
                self._hub.publish("services", body)
            case Received(Message(body=ServicesSubscribed())):
                self._hub.publish("services")
            case Received(Message(body=OrdersChanged(templates=templates, orders=orders))):
                self._orders_changed(templates=templates, orders=orders)
            case Received(Message(body=OrdersSubscribed(begun=started_at))) if started_at != self._scheduler_started_at:
                self._scheduler_started_at = started_at  # the Scheduler was restarted: earlier news may be lost
                self._orders_changed(templates=True, orders=True)
        return []

    def _orders_changed(self, *, templates: bool, orders: bool) -> None:
        for topic, changed in (("templates", templates), ("orders", orders)):
            if changed:
                self._hub.publish(topic)

    def _subscribe(self, now: float) -> list[Effect]:
        effects: list[Effect] = [
            SetTimer(RENEWAL, now + RENEWAL_INTERVAL),
            self._make_request(self._registry, SubscribeServices(lease=LEASE), now),
        ]
        if self._scheduler is not None:
            effects.append(self._make_request(self._scheduler, SubscribeOrders(lease=LEASE), now))
        return effects

    def _make_request(self, recipient: str, body: Body, now: float) -> Send:
        self._request_count += 1
        identity = message_id(self.address, recipient, RENEWAL, self._request_count, now)
        header = Header(sender=self.address, recipient=recipient, message_id=identity, reply_to=self.address)
        return Send(Message(header=header, body=body), expires_at=now + RENEWAL_INTERVAL)

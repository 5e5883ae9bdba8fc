"""A component that follows the Repository, the Registry and the Scheduler, and publishes their changes at the hub."""

from __future__ import annotations

import asyncio

from somrs.api.map_news import MapNews
from somrs.client.addresses import Addresses
from somrs.client.hub import Hub
from somrs.kernel.component import Effect, Input, Received, Send, SetTimer, Started, TimerFired
from somrs.kernel.not_understood import refuse_request
from somrs.kernel.replica import Replica
from somrs.kernel.service_replica import ServiceReplica, ServiceUpdate
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import ServicesSubscribed
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.orders import OrdersChanged, OrdersSubscribed, SubscribeOrders

LEASE = 30.0
"""Seconds for which the Scheduler is subscribed to."""
RENEWAL_INTERVAL = 10.0
"""Seconds after which the subscription is renewed."""
RENEWAL = "orders"
"""The name of the timer for the renewal."""


class Listener:
    """Follows the Repository, the Registry and the Scheduler.

    `replica` has the map and the ontology; `ready` is set when they have been read. `services` has the services on offer.
    """

    def __init__(self, address: str, addresses: Addresses, hub: Hub) -> None:
        self.address = address
        self.replica = Replica(address, addresses.repository)
        self.ready = asyncio.Event()
        self.services = ServiceReplica(address, addresses.registry, other_registries=addresses.further_registries)
        self._scheduler = addresses.scheduler
        self._scheduler_started_at: float | None = None
        self._hub = hub
        self._request_count = 0

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Started):
            return [*self.replica.start(now), *self.services.start(now), *self._subscribe(now)]
        news = self.replica.handle(event, now)
        if news is not None:
            if self.replica.ready:
                self.ready.set()
            if news.ontology_changed:
                self._hub.publish("ontology", self.replica.version)
            if news.changes or news.reloaded:
                self._hub.publish("map", MapNews(version=self.replica.version, changes=news.changes, read=news.reloaded))
            return news.effects
        update = self.services.handle(event, now)
        if update is not None:
            self._services_changed(update, event)
            return update.effects
        match event:
            case TimerFired(timer) if timer == RENEWAL:
                return self._subscribe(now)
            case Received(Message(body=OrdersChanged(templates=templates, orders=orders))):
                self._orders_changed(templates=templates, orders=orders)
            case Received(Message(body=OrdersSubscribed(begun=started_at))) if started_at != self._scheduler_started_at:
                self._scheduler_started_at = started_at  # the Scheduler was restarted: earlier news may be lost
                self._orders_changed(templates=True, orders=True)
            case Received(message):
                return [*refuse_request(message, "it is where the API learns what changes; the API itself is elsewhere")]
        return []

    def _services_changed(self, update: ServiceUpdate, event: Input) -> None:
        for news in update.news:
            self._hub.publish("services", news)
        # The Registry sends no news of offers that it withholds: they are read again from time to time.
        if update.reloaded or (isinstance(event, Received) and isinstance(event.message.body, ServicesSubscribed)):
            self._hub.publish("services")

    def _orders_changed(self, *, templates: bool, orders: bool) -> None:
        for topic, changed in (("templates", templates), ("orders", orders)):
            if changed:
                self._hub.publish(topic)

    def _subscribe(self, now: float) -> list[Effect]:
        if self._scheduler is None:
            return []
        return [SetTimer(RENEWAL, now + RENEWAL_INTERVAL), self._make_request(self._scheduler, SubscribeOrders(lease=LEASE), now)]

    def _make_request(self, recipient: str, body: Body, now: float) -> Send:
        self._request_count += 1
        identity = message_id(self.address, recipient, RENEWAL, self._request_count, now)
        header = Header(sender=self.address, recipient=recipient, message_id=identity, reply_to=self.address)
        return Send(Message(header=header, body=body), expires_at=now + RENEWAL_INTERVAL)

"""A component that follows the Repository and the Registry, and tells the hub of what changes there."""

from __future__ import annotations

import asyncio

from somrs.api.map_news import MapNews
from somrs.api.service_presence import Roster
from somrs.client.hub import Hub
from somrs.kernel.component import Effect, Input, Rang, Received, Send, Started, Wake
from somrs.kernel.replica import Replica
from somrs.protocol.messages.directory import ServicesJoined, ServicesLeft, ServicesSubscribed, SubscribeServices
from somrs.protocol.messages.envelope import Header, Message, message_id

LEASE = 30.0
"""Seconds for which the Registry is asked to send news."""
AGAIN = 10.0
"""Seconds after which it is asked again."""
RENEWAL = "services"
"""The timer of that."""


class Listener:
    """`replica` is the map and the ontology as far as is known here; `ready` is set once they were read. `roster`: who came and went."""

    def __init__(self, address: str, repository: str, registry: str, hub: Hub) -> None:
        self.address = address
        self.replica = Replica(address, repository)
        self.ready = asyncio.Event()
        self.roster = Roster()
        self._registry = registry
        self._hub = hub
        self._asked = 0

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Started):
            return [*self.replica.start(now), *self._subscribe(now)]
        news = self.replica.handle(event, now)
        if news is not None:
            if self.replica.ready:
                self.ready.set()
            if news.redefined:
                self._hub.publish("ontology", self.replica.version)
            if news.changes or news.read:
                self._hub.publish("map", MapNews(version=self.replica.version, changes=news.changes, read=news.read))
            return news.effects
        match event:
            case Rang(timer) if timer == RENEWAL:
                return self._subscribe(now)
            case Received(Message(body=ServicesJoined() | ServicesLeft() as body)):
                self.roster.heard(body, now)
                self._hub.publish("services", body)
            case Received(Message(body=ServicesSubscribed())):
                self._hub.publish("services")
        return []

    def _subscribe(self, now: float) -> list[Effect]:
        self._asked += 1
        identity = message_id(self.address, self._registry, RENEWAL, self._asked, now)
        header = Header(sender=self.address, recipient=self._registry, message_id=identity, reply_to=self.address)
        question = Send(Message(header=header, body=SubscribeServices(lease=LEASE)), until=now + AGAIN)
        return [question, Wake(RENEWAL, now + AGAIN)]

"""The Service Registry: which services there are now, and who wants to know when that changes.

Paper, "Service Registry": information about the services currently available. A service is there as long as its provider
renews its lease, so what falls silent leaves by itself. What is listed is kept, for whoever asks right after a restart; a provider
that is not known any more hears so at its next renewal, by a Fault, and publishes anew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain

import msgspec

from somrs.entish.formula import Formula
from somrs.entish.parse import parse
from somrs.errors import FormulaError, InputError, UsageError
from somrs.kernel.component import Effect, Input, Received, Record, Send, Started, Undelivered, Wake
from somrs.kernel.replica import Replica
from somrs.ontology.matching import can_bring_about
from somrs.ontology.objects import Map
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Ontology, Value
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import (
    Discover,
    Discovered,
    Offer,
    Publish,
    Published,
    Renew,
    Retract,
    Retracted,
    ServicesJoined,
    ServicesLeft,
    ServicesSubscribed,
    SubscribeServices,
)
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id, normalised_id, reply
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.leases import granted
from somrs.protocol.messages.paging import PAGE_BYTES
from somrs.registry.entries import Listed

LEASES = "leases"
"""The timer that rings when the next lease runs out."""

REMEMBERED = 10_000
"""So many publications, renewals and retractions are remembered: one that comes late a second time must not undo a newer one."""


@dataclass(slots=True, kw_only=True)
class _Provider:
    """What a device offers, by service name, and until when."""

    offers: dict[str, Offer]
    until: float


class Registry:
    """Knows the ontology it was given, and follows that of the Repository at the address `repository`, if there is one. `kept`: what
    was listed in an earlier life; None for a Registry that has no disk."""

    def __init__(
        self, address: str, ontology: Ontology | None = None, repository: str | None = None, kept: Iterable[Listed] | None = None
    ) -> None:
        self._address = address
        self._given = ontology if ontology is not None else Ontology()
        self._replica = Replica(address, repository) if repository is not None else None
        self._keeps = kept is not None
        self._providers = {one.provider: _Provider(offers={o.service: o for o in one.offers}, until=one.until) for one in kept or ()}
        self._subscribers: dict[str, float] = {}
        self._answered: dict[str, Body] = {}
        self._told = 0

    @property
    def ontology(self) -> Ontology:
        return self._replica.ontology if self._replica is not None and self._replica.ready else self._given

    @property
    def _map(self) -> Map | None:
        return self._replica.map if self._replica is not None and self._replica.ready else None

    def handle(self, event: Input, now: float) -> list[Effect]:
        """What to do about the input."""
        if self._replica is not None and (news := self._replica.handle(event, now)) is not None:
            return news.effects
        effects = self._expire(now)
        match event:
            case Started():
                effects += self._replica.start(now) if self._replica is not None else []
            case Received(message):
                try:
                    effects += self._received(message, now)
                except InputError as error:
                    effects.append(self._answer(message, Fault(code="Sender", text=str(error))))
            case Undelivered(Message(header=header, body=ServicesJoined() | ServicesLeft())):
                self._subscribers.pop(header.recipient, None)
        times = chain((provider.until for provider in self._providers.values()), self._subscribers.values())
        return [*effects, Wake(LEASES, min(times, default=None))]

    def _received(self, message: Message, now: float) -> list[Effect]:
        match message.body:
            case Publish() as publish:
                return self._once(message, publish.provider, lambda: self._publish(publish, now))
            case Renew() as renew:
                return self._once(message, renew.provider, lambda: self._renew(renew, now))
            case Retract() as retract:
                return self._once(message, retract.provider, lambda: self._retract(retract, now))
            case Discover() as discover:
                return [self._answer(message, self._discover(discover))]
            case SubscribeServices(lease=lease):
                if message.header.sender == ANONYMOUS:
                    raise UsageError("news can only be sent to somebody who has an address: set the sender to one that can be reached")
                self._subscribers[message.header.sender] = until = now + granted(lease)
                return [self._answer(message, ServicesSubscribed(until=until))]
            case Fault():
                return []  # a Fault is never answered, least of all by a Fault
            case body:
                text = f"a Registry does not understand {type(body).__name__}; it publishes, renews, retracts and discovers services"
                return [self._answer(message, Fault(code="ActionNotSupported", text=text))]

    def _answer(self, to: Message, body: Body) -> Send:
        return Send(reply(to, body, self._address))

    # Providers

    def _once(self, message: Message, provider: str, work: Callable[[], tuple[Body, list[Effect]]]) -> list[Effect]:
        """Carry it out, or answer it again if it was carried out."""
        request = normalised_id(message.header.message_id)
        if (answer := self._answered.get(request)) is not None:
            return [self._answer(message, answer)]
        answer, news = work()
        self._answered[request] = answer
        while len(self._answered) > REMEMBERED:
            del self._answered[next(iter(self._answered))]
        return [*self._kept(provider), self._answer(message, answer), *news]

    def _kept(self, provider: str) -> list[Effect]:
        if not self._keeps:
            return []
        known = self._providers.get(provider)
        offers, until = (tuple(known.offers.values()), known.until) if known is not None else ((), 0.0)
        return [Record(Listed(provider=provider, offers=offers, until=until))]

    def _publish(self, publish: Publish, now: float) -> tuple[Body, list[Effect]]:
        lease = granted(publish.lease)
        offers = self._checked(publish)
        known = self._providers.get(publish.provider)
        old = known.offers if known is not None else {}
        if offers:
            self._providers[publish.provider] = _Provider(offers=offers, until=now + lease)
        else:
            self._providers.pop(publish.provider, None)
        gone = [service for service in old if service not in offers]
        new = [offer for service, offer in offers.items() if old.get(service) != offer]
        return _published(now, lease), [*self._left(publish.provider, gone, "retracted", now), *self._joined(new, now)]

    def _checked(self, publish: Publish) -> dict[str, Offer]:
        """The offers by service; UsageError for those that nobody could use."""
        if not publish.provider:
            raise UsageError("who offers these services? `provider` is empty: give the name of the device on the map")
        for offer in publish.offers:
            if offer.provider != publish.provider:
                raise UsageError(
                    f"{offer.service} is {offer.provider}'s, and {publish.provider} cannot offer it: let {offer.provider} publish it"
                )
            other = next((name for name, p in self._providers.items() if offer.service in p.offers and name != publish.provider), None)
            if other is not None:
                raise UsageError(f"{offer.service} is offered by {other} already: give the service of {publish.provider} another name")
            for text in (offer.service_type.effect, offer.service_type.precondition):
                try:
                    _ = parse(text) if text is not None else None
                except FormulaError as error:
                    raise UsageError(f"{offer.service}, of type {offer.service_type.name}: {error}") from None
        offers = {offer.service: offer for offer in publish.offers}
        if len(offers) < len(publish.offers):
            raise UsageError(f"{publish.provider} offers two services of the same name: give each a name of its own")
        return offers

    def _renew(self, renew: Renew, now: float) -> tuple[Body, list[Effect]]:
        lease = granted(renew.lease)
        if (provider := self._providers.get(renew.provider)) is None:
            return Fault(code="Sender", text=f"nothing is registered for {renew.provider}: publish its services anew"), []
        provider.until = now + lease
        return _published(now, lease), []

    def _retract(self, retract: Retract, now: float) -> tuple[Body, list[Effect]]:
        provider = self._providers.get(retract.provider)
        if provider is None:
            return Retracted(services=()), []
        gone = [service for service in provider.offers if not retract.services or service in retract.services]
        for service in gone:
            del provider.offers[service]
        if not provider.offers:
            del self._providers[retract.provider]
        return Retracted(services=tuple(gone)), self._left(retract.provider, gone, "retracted", now)

    def _expire(self, now: float) -> list[Effect]:
        self._subscribers = {address: until for address, until in self._subscribers.items() if until > now}
        silent = [name for name, provider in self._providers.items() if provider.until <= now]
        return [effect for name in silent for effect in self._left(name, list(self._providers.pop(name).offers), "expired", now)]

    # Clients

    def _discover(self, discover: Discover) -> Discovered:
        wanted = parse(discover.effect) if discover.effect is not None else None
        offers = (offer for provider in self._providers.values() for offer in provider.offers.values())
        fitting = [offer for offer in offers if self._fits(offer, discover, wanted)]
        after = sorted((offer for offer in fitting if offer.service > discover.after), key=lambda offer: offer.service)
        page = next(_cut(after), [])
        return Discovered(offers=tuple(page), more=len(page) < len(after))

    def _fits(self, offer: Offer, wanted: Discover, effect: Formula | None) -> bool:
        return (
            (wanted.provider is None or offer.provider == wanted.provider)
            and (wanted.service_type is None or wanted.service_type in self._types(offer.service_type))
            and all(_same(offer.attributes.get(name), value) for name, value in wanted.attributes.items())
            and (effect is None or can_bring_about(offer.service_type, effect, self.ontology, self._map))
        )

    def _types(self, service_type: ServiceType) -> Iterator[str]:
        """The type of a service, and those above it."""
        seen: set[str] = set()
        current: ServiceType | None = service_type
        while current is not None and current.name not in seen:
            yield current.name
            seen.add(current.name)
            if current.parent is not None:
                yield current.parent
            current = self.ontology.services.get(current.parent) if current.parent is not None else None

    # News

    def _joined(self, offers: list[Offer], now: float) -> list[Effect]:
        return [effect for page in _cut(offers) for effect in self._tell(ServicesJoined(offers=tuple(page)), now)]

    def _left(self, provider: str, services: list[str], reason: str, now: float) -> list[Effect]:
        return self._tell(ServicesLeft(services=tuple(services), provider=provider, reason=reason), now) if services else []

    def _tell(self, news: ServicesJoined | ServicesLeft, now: float) -> list[Effect]:
        self._told += 1
        # The time is part of the id: after a restart, news are counted from 1 again.
        headers = [
            Header(sender=self._address, recipient=subscriber, message_id=message_id(self._address, subscriber, "news", self._told, now))
            for subscriber, until in self._subscribers.items()
            if until > now
        ]
        return [Send(Message(header=header, body=news)) for header in headers]


def _published(now: float, lease: float) -> Published:
    # Of three renewals, two may be lost.
    return Published(until=now + lease, renew_within=lease / 3)


def _same(one: Value | None, other: Value) -> bool:
    """Whether two values are equal; TRUE is not 1."""
    return one == other and isinstance(one, bool) == isinstance(other, bool)


def _cut(offers: Iterable[Offer]) -> Iterator[list[Offer]]:
    """The offers in lists that fit into one message each."""
    page: list[Offer] = []
    used = 0
    for offer in offers:
        size = len(msgspec.json.encode(offer))
        if page and used + size > PAGE_BYTES:
            yield page
            page, used = [], 0
        page.append(offer)
        used += size
    if page:
        yield page

"""The Service Registry: which services are available, and which subscribers receive changes.

Paper, "Service Registry": information about the services currently available. A service is listed as long as its provider renews its
lease, so that silent providers drop out. The list survives a restart, and so do the latest arrivals and departures. The Registry answers
the renewal of an unknown provider with a Fault; the provider then publishes its services again. It lists only offers that agree about the
definitions of service types (`listing.py`). `announcements.py` tells subscribers what changed, and a provider when a definition changes.

A Registry may have neighbours, other Registries (`neighbours.py`): it follows them like any client, lists what it takes of their offers,
and gives them what they may see of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import chain
from typing import Any, Self

from somrs.entish.parse import parse
from somrs.errors import FormulaError, InputError, UsageError
from somrs.kernel.admission import check_room
from somrs.kernel.codec import Migration, Schema
from somrs.kernel.component import DeliveryFailed, Effect, Effects, Input, Notified, Received, Send, SetTimer, Started
from somrs.kernel.replica import Replica
from somrs.kernel.subscription import Subscription
from somrs.limits import Limits
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import (
    AWAY,
    RETRACTED,
    Discover,
    Offer,
    PresenceLog,
    Publish,
    Published,
    ReadPresence,
    Renew,
    Retract,
    Retracted,
    ServicesJoined,
    ServicesLeft,
    ServicesSubscribed,
    SubscribeServices,
)
from somrs.protocol.messages.envelope import ANONYMOUS, Message, normalised_id, reply
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import MapChanged, OntologyChanged
from somrs.protocol.messages.leases import grant_lease
from somrs.protocol.messages.paging import fit_page
from somrs.registry.announcements import Announcements
from somrs.registry.discovery import Finder
from somrs.registry.listing import OWN, Listing, Views
from somrs.registry.neighbourhood import check_given, configure
from somrs.registry.neighbours import Configured, Neighbour
from somrs.registry.state import LeasesDue, Provider, RegistryState, Timer

REMEMBERED = 10_000
"""How many publications, renewals and retractions are remembered: a repeated request that arrives late must not undo a newer one."""

Answer = Published | Retracted | Fault


class Registry:
    """Lists the available services. Uses the given ontology until it has read that of the Repository at `repository`, if there is one."""

    def __init__(
        self, address: str, ontology: Ontology | None = None, repository: str | None = None, neighbours: Iterable[Neighbour] = ()
    ) -> None:
        replica = Replica(address, repository) if repository is not None else None
        self.state = RegistryState(address=address, initial_ontology=ontology if ontology is not None else Ontology(), replica=replica)
        configure(self.state, neighbours)

    @classmethod
    def restored(cls, state: RegistryState) -> Self:
        """Create a Registry from its state."""
        registry = cls.__new__(cls)
        registry.state = state
        return registry

    @property
    def open(self) -> list[str]:
        """Always empty: devices publish again what a Registry loses."""
        return []

    @property
    def ontology(self) -> Ontology:
        replica = self.state.replica
        return replica.ontology if replica is not None and replica.ready else self.state.initial_ontology

    @property
    def _map(self) -> Map | None:
        replica = self.state.replica
        return replica.map if replica is not None and replica.ready else None

    def handle(self, event: Input, now: float) -> list[Effect]:
        """Handle an input and return its effects."""
        return [*self._effects(event, now)]

    def _listing(self) -> Listing:
        state, replica = self.state, self.state.replica
        version = replica.version if replica is not None else math.inf
        return Listing(state.providers, self.ontology, version, self._map, state.neighbours.values())

    @property
    def _announcements(self) -> Announcements:
        return Announcements(self.state, self._listing())

    def check_admitted(self, message: Message, bounds: Limits) -> None:
        match message.body:
            case Publish(provider=provider):
                check_room("devices", bounds, self.state.providers, provider)
            case SubscribeServices():
                check_room("subscribers", bounds, self.state.subscribers, message.header.sender)

    def _effects(self, event: Input, now: float) -> Effects:
        state = self.state
        if isinstance(event, Received) and only_reads(event):
            yield from self._received(event.message, now)
            return
        listing = self._listing()
        if state.replica is not None and (news := state.replica.handle(event, now)) is not None:
            yield from news.effects
            if self._listing().differs(listing):
                yield from self._ontology_changed(listing, now)
            return
        followed = self._follow_neighbours(event, now)
        if followed is not None:
            yield from followed
        yield from self._expire(now)
        match event:
            case Started():
                yield from self._start(now)
            case Notified(Configured(neighbours)):
                yield from self._configure(neighbours, now)
            case Received(message) if followed is None:
                yield from self._received(message, now)
            case DeliveryFailed(Message(body=ServicesJoined(version=version) | ServicesLeft(version=version)) as message):
                self._undelivered(message.header.recipient, version)
        subscription_ends = (subscription.until for subscription in state.subscribers.values())
        absences = (neighbour.away_at for neighbour in state.neighbours.values() if neighbour.away_at is not None)
        times = chain((provider.expires_at for provider in state.providers.values()), subscription_ends, absences)
        yield SetTimer(LeasesDue(), min(times, default=None))

    def _start(self, now: float) -> Effects:
        state = self.state
        state.version = state.version or int(now * 1000)
        if state.replica is not None:
            yield from state.replica.start(now)
        for neighbour in state.neighbours.values():
            yield from neighbour.start(now)
        yield from self._announcements.announce_restart(now)

    def _undelivered(self, subscriber: str, version: int) -> None:
        """Drop a subscriber that cannot be reached, unless it subscribed again after the message was sent."""
        subscription = self.state.subscribers.get(subscriber)
        if subscription is not None and version > subscription.version:
            del self.state.subscribers[subscriber]

    def _received(self, message: Message, now: float) -> Effects:
        try:
            yield from self._handle_request(message, now)
        except InputError as error:
            yield self._answer(message, Fault(code="Sender", text=str(error)))

    def _handle_request(self, message: Message, now: float) -> Effects:
        match message.body:
            case Publish() as publish:
                yield from self._answer_once(message, lambda: self._publish(publish, now))
            case Renew() as renew:
                yield from self._answer_once(message, lambda: self._renew(renew, now))
            case Retract() as retract:
                yield from self._answer_once(message, lambda: self._retract(retract, now))
            case Discover() as discover:
                finder = Finder(self.state, self._listing(), self.ontology, self._map, now)
                yield self._answer(message, finder.discover(discover, self.state.audience(message.header.sender)))
            case ReadPresence():
                yield self._answer(message, PresenceLog(changes=tuple(fit_page(reversed(self.state.presence_log)))))
            case SubscribeServices() as subscribe:
                yield self._answer(message, self._subscribe(message.header.sender, subscribe, now))
            case Fault():
                pass  # a Fault is never answered, least of all by a Fault
            case MapChanged() | OntologyChanged():
                pass  # from a Repository that this Registry does not follow
            case body:
                text = f"a Registry does not understand {type(body).__name__}; it publishes, renews, retracts and discovers services"
                yield self._answer(message, Fault(code="ActionNotSupported", text=text))

    def _answer(self, request: Message, body: Body) -> Send:
        return Send(reply(request, body, self.state.address))

    # Providers

    def _answer_once(self, message: Message, work: Callable[[], tuple[Answer, list[Effect]]]) -> Effects:
        """Carry out a request, or repeat its answer if it was carried out before."""
        answered, request = self.state.answers, normalised_id(message.header.message_id)
        if (old_answer := answered.get(request)) is not None:
            yield self._answer(message, old_answer)
            return
        answer, news = work()
        answered[request] = answer
        while len(answered) > REMEMBERED:
            del answered[next(iter(answered))]
        yield self._answer(message, answer)
        yield from news

    def _publish(self, publish: Publish, now: float) -> tuple[Answer, list[Effect]]:
        lease, providers = grant_lease(publish.lease), self.state.providers
        offers = self._check_offers(publish)
        old_provider = providers.get(publish.provider)
        old_offers = old_provider.offers.values() if old_provider is not None else ()
        old_views = self._views_with_rivals([publish.provider], [*old_offers, *offers.values()])
        if offers:
            # A provider that publishes again keeps its place: of a type that only providers define, the first one's definition counts.
            version = max(publish.ontology_version, 0)
            providers[publish.provider] = Provider(offers=offers, expires_at=now + lease, ontology_version=version)
        else:
            providers.pop(publish.provider, None)
        effects = self._announcements.announce(old_views, RETRACTED, now, requester=publish.provider)
        return self._published(publish.provider, lease, now), effects

    def _check_offers(self, publish: Publish) -> dict[str, Offer]:
        """The offers by service name. Raises UsageError for offers that cannot be used."""
        if not publish.provider:
            raise UsageError("`provider` is empty: give the name of the device on the map")
        for offer in publish.offers:
            if offer.provider != publish.provider:
                raise UsageError(
                    f"{offer.service} belongs to {offer.provider}, and {publish.provider} cannot offer it: let {offer.provider} publish it"
                )
            other_provider = next(
                (name for name, p in self.state.providers.items() if offer.service in p.offers and name != publish.provider), None
            )
            if other_provider is not None:
                raise UsageError(
                    f"{offer.service} is offered by {other_provider} already: give the service of {publish.provider} another name"
                )
            for text in (offer.service_type.effect, offer.service_type.precondition, offer.service_type.invariant):
                try:
                    _ = parse(text) if text is not None else None
                except FormulaError as error:
                    raise UsageError(f"{offer.service}, of type {offer.service_type.name}: {error}") from None
        offers = {offer.service: offer for offer in publish.offers}
        if len(offers) < len(publish.offers):
            raise UsageError(f"{publish.provider} offers two services of the same name: give each a name of its own")
        return offers

    def _renew(self, renew: Renew, now: float) -> tuple[Answer, list[Effect]]:
        lease = grant_lease(renew.lease)
        if (provider := self.state.providers.get(renew.provider)) is None:
            return Fault(code="Sender", text=f"nothing is registered for {renew.provider}: publish its services anew"), []
        provider.expires_at = now + lease
        return self._published(renew.provider, lease, now), []

    def _published(self, provider: str, lease: float, now: float) -> Published:
        withheld = tuple(reason for _, reason in self._listing().withheld_of((OWN, provider)))
        # Two of three renewals may be lost.
        return Published(until=now + lease, renew_within=lease / 3, withheld=withheld, other_registries=self.state.other_registries)

    def _retract(self, retract: Retract, now: float) -> tuple[Answer, list[Effect]]:
        provider = self.state.providers.get(retract.provider)
        if provider is None:
            return Retracted(services=()), []
        removed_services = [service for service in provider.offers if not retract.services or service in retract.services]
        old_views = self._views_with_rivals([retract.provider], [provider.offers[service] for service in removed_services])
        for service in removed_services:
            del provider.offers[service]
        if not provider.offers:
            del self.state.providers[retract.provider]
        return Retracted(services=tuple(removed_services)), self._announcements.announce(old_views, RETRACTED, now)

    def _expire(self, now: float) -> Effects:
        subscribers, providers = self.state.subscribers, self.state.providers
        self.state.subscribers = {address: subscription for address, subscription in subscribers.items() if subscription.until > now}
        silent = sorted((provider.expires_at, name) for name, provider in providers.items() if provider.expires_at <= now)
        names = [name for _, name in silent]
        old_views = self._views_with_rivals(names, [offer for name in names for offer in providers[name].offers.values()])
        expiries = {name: providers.pop(name).expires_at for name in names}
        yield from self._announcements.announce(old_views, "expired", now, expiries=expiries)
        for neighbour in self.state.neighbours.values():
            if not neighbour.is_away and neighbour.is_silent(now):
                old_views = self._views_with_rivals([], self._listing().taken_from(neighbour.settings.name).values())
                neighbour.is_away = True
                yield from self._announcements.announce(old_views, AWAY, now)

    def _ontology_changed(self, listing: Listing, now: float) -> Effects:
        # With the map of a neighbour, its devices get other names.
        old_views = listing.views((*listing.keys, *self._listing().keys))
        if self._listing().version < listing.version:  # the Repository's store begins anew: its versions say nothing about earlier ones
            for provider in self.state.providers.values():
                provider.ontology_version = 0
        yield from self._announcements.announce(old_views, RETRACTED, now)

    def _views_with_rivals(self, names: Iterable[str], offers: Iterable[Offer]) -> Views:
        """What is listed of these providers, and of those that the arrival or departure of `offers` concerns."""
        listing = self._listing()
        return listing.views((*((OWN, name) for name in names), *sorted(listing.rivals(offers))))

    # Neighbours

    def _configure(self, neighbours: Iterable[Neighbour], now: float) -> Effects:
        listing = self._listing()
        old_views = listing.views(listing.keys)
        yield from configure(self.state, neighbours)
        yield from self._announcements.announce(old_views, RETRACTED, now)

    def _follow_neighbours(self, event: Input, now: float) -> list[Effect] | None:
        """The effects of an input that concerns the copy of a neighbour's offers; None if it does not."""
        for name, neighbour in self.state.neighbours.items():
            listing, old_offers = self._listing(), neighbour.offers
            update = neighbour.copy.handle(event, now) if neighbour.copy is not None else None
            if update is None:
                continue
            neighbour.is_away = neighbour.is_away and neighbour.is_silent(now)
            if neighbour.offers is old_offers:
                return update.effects
            new_listing = self._listing()
            old_taken, new_taken = listing.taken_from(name), new_listing.taken_from(name)
            changes = ((old_taken.get(service), new_taken.get(service)) for service in {**old_taken, **new_taken})
            concerned = [offer for old, new in changes if old != new for offer in (old, new) if offer is not None]
            old_views = listing.views(sorted(listing.rivals(concerned) | new_listing.rivals(concerned)))
            left_services = ((service, news.reason) for news in update.news if isinstance(news, ServicesLeft) for service in news.services)
            reasons = {old_taken[service].service: reason for service, reason in left_services if service in old_taken}
            return [*update.effects, *self._announcements.announce(old_views, RETRACTED, now, reasons=reasons)]
        return None

    # Clients

    def _subscribe(self, sender: str, subscribe: SubscribeServices, now: float) -> ServicesSubscribed:
        state = self.state
        if sender == ANONYMOUS:
            raise UsageError("a subscription needs a sender address: set the sender to an address that can be reached")
        audience = state.audience(sender)
        if audience or subscribe.neighbour:
            check_given(state, sender)
        subscription = Subscription(until=now + grant_lease(subscribe.lease), version=state.version_for(audience))
        state.subscribers[sender] = subscription
        # Neighbours follow each Registry of the site by itself.
        other_registries = () if audience else state.other_registries
        silent = [neighbour for neighbour in state.neighbours.values() if neighbour.is_silent(now) and not neighbour.settings.is_of_site]
        silent_names = tuple(neighbour.settings.name for neighbour in silent) if not audience else ()
        return ServicesSubscribed(
            until=subscription.until, version=subscription.version, other_registries=other_registries, away=silent_names
        )


def only_reads(event: Input) -> bool:
    """Whether an input is a query that is answered on its connection.

    Such a query may be lost with the process, because its connection is. A reply to an address has to be sent after a restart, too.
    """
    if not isinstance(event, Received):
        return False
    return isinstance(event.message.body, Discover | ReadPresence) and event.message.header.reply_to == ANONYMOUS


def _with_subscriptions(snapshot: Any) -> Any:
    """Give each subscription its version. In version 2, it was the time at which it expires."""
    subscribers = snapshot["state"]["subscribers"]
    snapshot["state"]["subscribers"] = {address: {"until": expires_at, "version": 0} for address, expires_at in subscribers.items()}
    return snapshot


SCHEMA = Schema(
    component="registry",
    version=4,
    state=RegistryState,
    timers=Timer,
    questions=None,
    tasks=None,
    answers=None,
    notices=Configured,
    restore=Registry.restored,
    is_read_only=only_reads,
    # Version 2 adds the log of arrivals and departures, version 4 neighbours.
    migrations={1: Migration(), 2: Migration(snapshot=_with_subscriptions), 3: Migration()},
)
"""The types in the journal of a Registry."""

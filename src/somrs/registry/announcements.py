"""What the Registry announces: arrivals and departures of services, to its subscribers; new definitions of service types, to providers.

It also keeps the log of arrivals and departures. Which offers are listed is decided in `listing.py`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from somrs.kernel.component import Effect, Send
from somrs.protocol.messages.directory import (
    OUTDATED,
    REPUBLISHING_TIME,
    WITHHELD,
    Offer,
    PresenceChange,
    ServicesJoined,
    ServicesLeft,
    ServicesSubscribed,
    ServiceTypesChanged,
)
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.paging import pages
from somrs.registry.listing import OWN, Listing, OffersByService, ProviderKey, Views
from somrs.registry.state import RegistryState

LOG_LENGTH = 200
"""How many arrivals and departures are remembered."""


class Announcements:
    """Announces how the present listing differs from an earlier one. It has no state of its own."""

    def __init__(self, state: RegistryState, listing: Listing) -> None:
        self._state, self._listing = state, listing

    def announce(
        self,
        old_views: Views,
        reason: str,
        now: float,
        *,
        reasons: Mapping[str, str] = MappingProxyType({}),
        expiries: Mapping[str, float] = MappingProxyType({}),
        requester: str | None = None,
    ) -> list[Effect]:
        """Announce which offers are listed now and were not before, or not as they are now, and which services are not listed any more.

        `reason`: why services left that nobody offers now, unless `reasons` has another one for the service; `expiries`: when the leases
        of providers expired, if that is earlier than `now`. A provider whose services are withheld is told so, unless it is the requester,
        which learns it from the answer.
        """
        effects: list[Effect] = []
        views = self._listing.views(old_views.providers).audiences
        for audience, offers in views.items():
            old_offers = old_views.audiences.get(audience, offers)  # a new neighbour has not read anything
            added_offers = _by_provider(offer for service, offer in offers.items() if service not in old_offers)
            changed_offers = _by_provider(offer for service, offer in offers.items() if old_offers.get(service) != offer)
            left_offers = _by_provider(offer for service, offer in old_offers.items() if service not in offers)
            # First those that left: of two services with one name, one may take the place of the other.
            for key in left_offers:
                for why, removed in self._by_reason(left_offers[key], views[OWN], reason, reasons).items():
                    effects += self._announce_left(audience, key, removed, why, now, expiries.get(key[1]))
                    if why == OUTDATED and audience == key[0] == OWN and key[1] != requester:
                        effects += self._tell_provider(key[1], removed, now)
            for key in changed_offers:
                effects += self._announce_joined(audience, key, added_offers.get(key, ()), changed_offers[key], now)
        return effects

    def _by_reason(
        self, offers: Iterable[Offer], listed: OffersByService, reason: str, reasons: Mapping[str, str]
    ) -> dict[str, list[Offer]]:
        """The offers that an audience does not see any more, by the reasons. `listed`: what this system sees; a neighbour may see less."""
        grouped: dict[str, list[Offer]] = {}
        for offer in offers:
            if offer.service not in listed and self._listing.publishes(offer):
                why = OUTDATED if offer.registry == OWN else WITHHELD
            else:
                why = reasons.get(offer.service, reason)
            grouped.setdefault(why, []).append(offer)
        return grouped

    def _tell_provider(self, provider: str, offers: list[Offer], now: float) -> list[Effect]:
        self._state.providers[provider].expected_by = now + REPUBLISHING_TIME
        types = tuple(dict.fromkeys(offer.service_type.name for offer in offers))
        addresses = dict.fromkeys(offer.address for offer in offers)
        return self._notify(addresses, ServiceTypesChanged(provider=provider, service_types=types), now)

    def _announce_joined(
        self, audience: str, key: ProviderKey, added_offers: Iterable[Offer], offers: list[Offer], now: float
    ) -> list[Effect]:
        """Announce offers that are new or have changed; the new ones are `added_offers`."""
        self._log(audience, PresenceChange(at=now, device=key[1], services=_services(added_offers), joined=True, registry=key[0]))
        return [
            effect
            for page in pages(offers)
            for effect in self._notify_subscribers(audience, ServicesJoined(offers=tuple(page), version=self._next_version(audience)), now)
        ]

    def _announce_left(
        self, audience: str, key: ProviderKey, offers: list[Offer], reason: str, now: float, left_at: float | None = None
    ) -> list[Effect]:
        """Announce services that left now or, if the Registry was not running then, at an earlier time."""
        at, (registry, provider), services = left_at if left_at is not None else now, key, _services(offers)
        change = PresenceChange(at=at, device=provider, services=services, joined=False, reason=reason, registry=registry)
        self._log(audience, change)
        left = ServicesLeft(services=services, provider=provider, reason=reason, version=self._next_version(audience))
        return self._notify_subscribers(audience, left, now)

    def announce_restart(self, now: float) -> list[Effect]:
        """Tell subscribers the version, because earlier news may not have reached them."""
        effects: list[Effect] = []
        for address, subscription in self._state.subscribers.items():
            version = self._state.version_for(self._state.audience(address))
            effects += self._notify([address], ServicesSubscribed(until=subscription.until, version=version), now)
        return effects

    def _next_version(self, audience: str) -> int:
        if audience == OWN:
            self._state.version += 1
        else:
            self._state.neighbours[audience].version += 1
        return self._state.version_for(audience)

    def _log(self, audience: str, change: PresenceChange) -> None:
        if change.services and audience == OWN:
            self._state.presence_log.append(change)
            del self._state.presence_log[:-LOG_LENGTH]

    def _notify_subscribers(self, audience: str, news: ServicesJoined | ServicesLeft, now: float) -> list[Effect]:
        subscribers = self._state.subscribers.items()
        recipients = [address for address, entry in subscribers if entry.until > now and self._state.audience(address) == audience]
        return self._notify(recipients, news, now)

    def _notify(
        self, recipients: Iterable[str], news: ServicesJoined | ServicesLeft | ServicesSubscribed | ServiceTypesChanged, now: float
    ) -> list[Effect]:
        self._state.news_count += 1
        # The time is part of the id: a Registry that lost its state numbers its notifications from 1 again.
        ids = {recipient: message_id(self._state.address, recipient, "news", self._state.news_count, now) for recipient in recipients}
        headers = [Header(sender=self._state.address, recipient=recipient, message_id=id) for recipient, id in ids.items()]
        return [Send(Message(header=header, body=news)) for header in headers]


def _by_provider(offers: Iterable[Offer]) -> dict[ProviderKey, list[Offer]]:
    grouped: dict[ProviderKey, list[Offer]] = {}
    for offer in offers:
        grouped.setdefault((offer.registry, offer.provider), []).append(offer)
    return grouped


def _services(offers: Iterable[Offer]) -> tuple[str, ...]:
    return tuple(offer.service for offer in offers)

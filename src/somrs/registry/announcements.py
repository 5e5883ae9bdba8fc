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
    Offer,
    PresenceChange,
    ServicesJoined,
    ServicesLeft,
    ServicesSubscribed,
    ServiceTypesChanged,
)
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.paging import pages
from somrs.registry.listing import ListedOffers, Listing
from somrs.registry.state import RegistryState

LOG_LENGTH = 200
"""How many arrivals and departures are remembered."""


class Announcements:
    """Announces how the present listing differs from an earlier one. It has no state of its own."""

    def __init__(self, state: RegistryState, listing: Listing) -> None:
        self._state, self._listing = state, listing

    def announce(
        self,
        before: ListedOffers,
        reason: str,
        now: float,
        expiries: Mapping[str, float] = MappingProxyType({}),
        requester: str | None = None,
    ) -> list[Effect]:
        """Announce which offers are listed now and were not before, or not as they are now, and which services are not listed any more.

        `reason`: why services left that their provider does not offer now; `expiries`: when their leases expired, if that is earlier than
        `now`. A provider whose services are withheld is told so, unless it is the requester, which learns it from the answer.
        """
        effects: list[Effect] = []
        for name, offers in self._listing.listed(before).items():
            old, provider = before[name], self._state.providers.get(name)
            published = provider.offers if provider is not None else {}
            removed = [service for service in old if service not in offers]
            outdated = [service for service in removed if service in published]
            gone = [service for service in removed if service not in published]
            changed = [offer for service, offer in offers.items() if old.get(service) != offer]
            effects += self._announce_left(name, gone, reason, now, expiries.get(name))
            effects += self._announce_left(name, outdated, OUTDATED, now)
            effects += self._announce_joined(name, [service for service in offers if service not in old], changed, now)
            if outdated and name != requester:
                effects += self._tell_provider(name, [published[service] for service in outdated], now)
        return effects

    def _tell_provider(self, provider: str, offers: list[Offer], now: float) -> list[Effect]:
        self._state.providers[provider].expected_by = now + REPUBLISHING_TIME
        types = tuple(dict.fromkeys(offer.service_type.name for offer in offers))
        addresses = dict.fromkeys(offer.address for offer in offers)
        return self._notify(addresses, ServiceTypesChanged(provider=provider, service_types=types), now)

    def _announce_joined(self, provider: str, added_services: list[str], offers: list[Offer], now: float) -> list[Effect]:
        """Announce offers that are new or have changed; the services of the new ones are `added_services`."""
        self._log(PresenceChange(at=now, device=provider, services=tuple(added_services), joined=True))
        return [
            effect
            for page in pages(offers)
            for effect in self._notify_subscribers(ServicesJoined(offers=tuple(page), version=self._next_version()), now)
        ]

    def _announce_left(self, provider: str, services: list[str], reason: str, now: float, left_at: float | None = None) -> list[Effect]:
        """Announce services that left now or, if the Registry was not running then, at an earlier time."""
        at = left_at if left_at is not None else now
        self._log(PresenceChange(at=at, device=provider, services=tuple(services), joined=False, reason=reason))
        if not services:
            return []
        left = ServicesLeft(services=tuple(services), provider=provider, reason=reason, version=self._next_version())
        return self._notify_subscribers(left, now)

    def announce_restart(self, now: float) -> list[Effect]:
        """Tell subscribers the version, because earlier news may not have reached them."""
        effects: list[Effect] = []
        for address, subscription in self._state.subscribers.items():
            effects += self._notify([address], ServicesSubscribed(until=subscription.until, version=self._state.version), now)
        return effects

    def _next_version(self) -> int:
        self._state.version += 1
        return self._state.version

    def _log(self, change: PresenceChange) -> None:
        if change.services:
            self._state.presence_log.append(change)
            del self._state.presence_log[:-LOG_LENGTH]

    def _notify_subscribers(self, news: ServicesJoined | ServicesLeft, now: float) -> list[Effect]:
        return self._notify([address for address, subscription in self._state.subscribers.items() if subscription.until > now], news, now)

    def _notify(
        self, recipients: Iterable[str], news: ServicesJoined | ServicesLeft | ServicesSubscribed | ServiceTypesChanged, now: float
    ) -> list[Effect]:
        self._state.news_count += 1
        # The time is part of the id: a Registry that lost its state numbers its notifications from 1 again.
        ids = {recipient: message_id(self._state.address, recipient, "news", self._state.news_count, now) for recipient in recipients}
        headers = [Header(sender=self._state.address, recipient=recipient, message_id=id) for recipient, id in ids.items()]
        return [Send(Message(header=header, body=news)) for header in headers]

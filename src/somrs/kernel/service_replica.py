"""A copy of what the Service Registry lists, for components that choose among services. How it is followed is in `following.py`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from msgspec import Struct, field

from somrs.kernel.component import Effect, Input, Send
from somrs.kernel.following import LEASE, PATIENCE, Following, Reading
from somrs.kernel.offers import Offers
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import (
    OUTDATED,
    REPUBLISHING_TIME,
    Discover,
    Discovered,
    Offer,
    ServicesJoined,
    ServicesLeft,
    ServicesSubscribed,
    SubscribeServices,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ServiceUpdate:
    """The result of an input: `effects` to carry out, the Registry's `news`, and the services that `joined`: offers that are new or have
    changed. `reloaded`: before the news, everything was read again."""

    effects: list[Effect]
    news: tuple[ServicesJoined | ServicesLeft, ...] = ()
    joined: tuple[str, ...] = ()
    reloaded: bool = False


class OffersReading(Reading, kw_only=True):
    """The pages read so far. `unsettled`: providers were about to publish again."""

    offers: list[Offer] = field(default_factory=list)
    unsettled: bool = False


class ServicesDue(Struct, frozen=True, tag=True):
    """The timer of a component's copy of the offers."""


class ServiceReplica(Following[ServicesJoined | ServicesLeft, OffersReading]):
    """`offers` are the Registry's as far as received. The owner passes every input to `handle` first."""

    SUBSCRIBED = ServicesSubscribed
    QUESTIONS = (SubscribeServices, Discover)
    PAGES = (Discovered,)
    EVENTS = (ServicesJoined, ServicesLeft)

    owner: str
    registry: str
    offers: Offers = field(default_factory=Offers)
    other_registries: tuple[str, ...] = ()
    """The other Registries of the site, which list the same. One of them is followed when the present one does not answer."""
    turned_at: float = 0.0
    """When the present Registry began to be followed."""
    copied_from: str = ""
    """The Registry whose offers these are; empty: not known."""
    expected: dict[str, float] = {}
    """Until when providers are expected to publish again, because service types are defined anew. The name may be empty: some provider."""
    away: tuple[str, ...] = ()
    """The neighbours of the Registry that do not answer."""

    def handle(self, event: Input, now: float) -> ServiceUpdate | None:
        """Handle an input; None if it does not concern the replica."""
        old_offers = self.offers
        followed = self.follow(event, now)
        if followed is None:
            return None
        for change in followed.events:
            self._apply(change, now)
        joined = tuple(offer.service for offer in self.offers if offer not in old_offers) if self.offers is not old_offers else ()
        return ServiceUpdate(effects=followed.effects, news=followed.events, joined=joined, reloaded=followed.reloaded)

    def start(self, now: float) -> list[Effect]:
        self.turned_at = now
        return super().start(now)

    def settles_at(self, now: float) -> float | None:
        """When no provider is expected to publish again any more; None if none is."""
        self.expected = {provider: time for provider, time in self.expected.items() if time > now}
        return max(self.expected.values(), default=None)

    @property
    def timer(self) -> Any:
        return ServicesDue()

    @property
    def publisher(self) -> str:
        return self.registry

    def _subscription(self) -> Body:
        return SubscribeServices(lease=LEASE)

    def _subscribe(self, now: float) -> Send:
        if self.other_registries and now >= self._answer_awaited_until:
            self.registry, *remaining = (*self.other_registries, self.registry)
            self.other_registries, self.turned_at = tuple(remaining), now
        return super()._subscribe(now)

    @property
    def _answer_awaited_until(self) -> float:
        """Until when the present Registry may be silent before another one is followed: as long as the copy is up to date if it is slow."""
        if not self.ready and self.known_since < self.turned_at:
            return self.turned_at + PATIENCE
        return max(self.known_since, self.turned_at) + LEASE

    def _subscribed(self, answer: ServicesSubscribed, now: float) -> list[Effect]:
        self.away = answer.away
        self.other_registries = tuple(address for address in answer.other_registries if address != self.registry) or self.other_registries
        if self.copied_from not in ("", self.registry):
            self._begin_anew()
        return super()._subscribed(answer, now)

    def _new_reading(self) -> OffersReading:
        return OffersReading()

    def _first_question(self) -> Body:
        return Discover()

    def _version_of(self, event: ServicesJoined | ServicesLeft) -> int:
        return event.version

    def _add_page(self, reading: OffersReading, page: Discovered) -> Body | None:
        reading.offers += page.offers
        reading.unsettled = reading.unsettled or page.unsettled
        return Discover(after=page.offers[-1].service) if page.more and page.offers else None

    def _adopt(self, reading: OffersReading, now: float) -> None:
        self.offers, self.copied_from = Offers(reading.offers), self.registry
        self.expected = {"": now + REPUBLISHING_TIME} if reading.unsettled else {}

    def _apply(self, event: ServicesJoined | ServicesLeft, now: float) -> None:
        if isinstance(event, ServicesJoined):
            self.offers = self.offers.changed(event.offers)
            for offer in event.offers:
                self.expected.pop(offer.provider, None)
        else:
            self.offers = self.offers.changed(removed_services=event.services)
            if event.reason == OUTDATED:
                self.expected[event.provider] = now + REPUBLISHING_TIME

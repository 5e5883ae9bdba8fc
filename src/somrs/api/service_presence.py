"""Who offers services now, and who came and went lately."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator

import msgspec

from somrs.protocol.messages.directory import Offer, ServicesJoined, ServicesLeft

MAX_CHANGES = 200
"""Comings and goings that are remembered."""

UNSEEN = "left while nobody heard of it"
"""Why a service is gone whose going was not told."""


class PresenceChange(msgspec.Struct, frozen=True, kw_only=True):
    """A device's services came, or went and why, at seconds since 1970."""

    at: float
    device: str
    services: tuple[str, ...]
    joined: bool
    reason: str = ""


class ServicePresence:
    """Hears the Registry's news. As news may be lost, what it is told of all offers counts more. `log` is the oldest first."""

    def __init__(self) -> None:
        self.log: deque[PresenceChange] = deque(maxlen=MAX_CHANGES)
        self.offers: dict[str, Offer] = {}
        self.read_at: float | None = None
        """When all offers were read; None: not yet."""

    def handle_news(self, news: ServicesJoined | ServicesLeft, now: float) -> None:
        if isinstance(news, ServicesJoined):
            self._record_arrivals(news.offers, now)
        else:
            self._record_departures([name for name in news.services if name in self.offers], news.reason, now)

    def read(self, offers: Iterable[Offer], now: float) -> None:
        """All that is on offer now."""
        current_offers = {offer.service: offer for offer in offers}
        if self.read_at is None:
            self.offers = {**current_offers, **self.offers}  # they were there before anybody listened
        else:
            self._record_departures([name for name in self.offers if name not in current_offers], UNSEEN, now)
            self._record_arrivals(current_offers.values(), now)
        self.read_at = now

    def last_departure(self, device: str) -> PresenceChange | None:
        """When and why a device that offers nothing left; None if it was not heard of."""
        return next((change for change in reversed(self.log) if change.device == device and not change.joined), None)

    def last_arrival(self, device: str) -> PresenceChange | None:
        return next((change for change in reversed(self.log) if change.device == device and change.joined), None)

    def _record_arrivals(self, offers: Iterable[Offer], now: float) -> None:
        new = [offer for offer in offers if self.offers.get(offer.service) != offer]
        for device, services in _by_device((offer.provider, offer.service) for offer in new if offer.service not in self.offers):
            self.log.append(PresenceChange(at=now, device=device, services=services, joined=True))
        self.offers.update({offer.service: offer for offer in new})

    def _record_departures(self, services: Iterable[str], reason: str, now: float) -> None:
        for device, names in _by_device((self.offers.pop(name).provider, name) for name in services):
            self.log.append(PresenceChange(at=now, device=device, services=names, joined=False, reason=reason))


def _by_device(services: Iterable[tuple[str, str]]) -> Iterator[tuple[str, tuple[str, ...]]]:
    names_by_device: dict[str, list[str]] = {}
    for device, service in services:
        names_by_device.setdefault(device, []).append(service)
    yield from ((device, tuple(names)) for device, names in names_by_device.items())

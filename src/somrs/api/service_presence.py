"""The services on offer now, and the latest arrivals and departures of devices."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator

import msgspec

from somrs.protocol.messages.directory import Offer, ServicesJoined, ServicesLeft

MAX_CHANGES = 200
"""Maximum number of arrivals and departures in the log."""

UNSEEN = "its departure was not reported"
"""The reason of a departure that was not reported."""


class PresenceChange(msgspec.Struct, frozen=True, kw_only=True):
    """The arrival (`joined`) or departure of services of a device. `at`: seconds since 1970; `reason`: of a departure."""

    at: float
    device: str
    services: tuple[str, ...]
    joined: bool
    reason: str = ""


class ServicePresence:
    """The services on offer according to the Registry's news. News may be lost: `read` corrects the state. `log`: the oldest first."""

    def __init__(self) -> None:
        self.log: deque[PresenceChange] = deque(maxlen=MAX_CHANGES)
        self.offers: dict[str, Offer] = {}
        self.read_at: float | None = None
        """When all offers were last read; None if they have not been read yet."""

    def handle_news(self, news: ServicesJoined | ServicesLeft, now: float) -> None:
        if isinstance(news, ServicesJoined):
            self._record_arrivals(news.offers, now)
        else:
            self._record_departures([name for name in news.services if name in self.offers], news.reason, now)

    def read(self, offers: Iterable[Offer], now: float) -> None:
        """Take over the complete list of offers."""
        current_offers = {offer.service: offer for offer in offers}
        if self.read_at is None:
            self.offers = {**current_offers, **self.offers}  # they joined before this process did
        else:
            self._record_departures([name for name in self.offers if name not in current_offers], UNSEEN, now)
            self._record_arrivals(current_offers.values(), now)
        self.read_at = now

    def last_departure(self, device: str) -> PresenceChange | None:
        """The latest departure of the device; None if none was observed."""
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

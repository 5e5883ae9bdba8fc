"""Who offers services now, and who came and went lately."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator

import msgspec

from somrs.protocol.messages.directory import Offer, ServicesJoined, ServicesLeft

KEPT = 200
"""Comings and goings that are remembered."""

UNSEEN = "left while nobody heard of it"
"""Why a service is gone whose going was not told."""


class Coming(msgspec.Struct, frozen=True, kw_only=True):
    """A device's services came, or went and why, at seconds since 1970."""

    at: float
    device: str
    services: tuple[str, ...]
    joined: bool
    reason: str = ""


class Roster:
    """Hears the Registry's news. As news may be lost, what it is told of all offers counts more. `log` is the oldest first."""

    def __init__(self) -> None:
        self.log: deque[Coming] = deque(maxlen=KEPT)
        self.offers: dict[str, Offer] = {}
        self.read_at: float | None = None
        """When all offers were read; None: not yet."""

    def heard(self, news: ServicesJoined | ServicesLeft, now: float) -> None:
        if isinstance(news, ServicesJoined):
            self._joined(news.offers, now)
        else:
            self._left([name for name in news.services if name in self.offers], news.reason, now)

    def read(self, offers: Iterable[Offer], now: float) -> None:
        """All that is on offer now."""
        found = {offer.service: offer for offer in offers}
        if self.read_at is None:
            self.offers = {**found, **self.offers}  # they were there before anybody listened
        else:
            self._left([name for name in self.offers if name not in found], UNSEEN, now)
            self._joined(found.values(), now)
        self.read_at = now

    def last_going(self, device: str) -> Coming | None:
        """When and why a device that offers nothing left; None if it was not heard of."""
        return next((one for one in reversed(self.log) if one.device == device and not one.joined), None)

    def last_coming(self, device: str) -> Coming | None:
        return next((one for one in reversed(self.log) if one.device == device and one.joined), None)

    def _joined(self, offers: Iterable[Offer], now: float) -> None:
        new = [offer for offer in offers if self.offers.get(offer.service) != offer]
        for device, services in _by_device((offer.provider, offer.service) for offer in new if offer.service not in self.offers):
            self.log.append(Coming(at=now, device=device, services=services, joined=True))
        self.offers.update({offer.service: offer for offer in new})

    def _left(self, services: Iterable[str], reason: str, now: float) -> None:
        for device, gone in _by_device((self.offers.pop(name).provider, name) for name in services):
            self.log.append(Coming(at=now, device=device, services=gone, joined=False, reason=reason))


def _by_device(services: Iterable[tuple[str, str]]) -> Iterator[tuple[str, tuple[str, ...]]]:
    found: dict[str, list[str]] = {}
    for device, service in services:
        found.setdefault(device, []).append(service)
    yield from ((device, tuple(names)) for device, names in found.items())

"""The services on offer now, and the latest arrivals and departures of devices."""

from __future__ import annotations

from somrs.client.client import Client
from somrs.protocol.messages.directory import Offer, PresenceChange, ServicesJoined, ServicesLeft

STALE = 10.0
"""Seconds after which everything is read again, since news may have been lost."""


class ServicePresence:
    """The services on offer, and the Registry's log of arrivals and departures, newest first.

    The Registry's news keep the offers up to date; `read` reads the log after news, and everything from time to time.
    """

    def __init__(self) -> None:
        self.log: tuple[PresenceChange, ...] = ()
        self.offers: dict[str, Offer] = {}
        self._news_count = 0
        self._logged_news: int | None = None
        """The number of news when the log was last read; None if it has not been read yet."""
        self._offers_read_at: float | None = None

    def handle_news(self, news: ServicesJoined | ServicesLeft) -> None:
        self._news_count += 1
        if isinstance(news, ServicesJoined):
            self.offers.update({offer.service: offer for offer in news.offers})
        else:
            for service in news.services:
                self.offers.pop(service, None)

    async def read(self, client: Client, now: float) -> None:
        news_count = self._news_count
        is_stale = self._offers_read_at is None or now - self._offers_read_at > STALE
        if is_stale:
            self.offers = {offer.service: offer for offer in await client.services()}
            # News that came meanwhile may be newer than the answer.
            self._offers_read_at = now if self._news_count == news_count else None
        if is_stale or self._logged_news != news_count:
            self.log = await client.presence()
            self._logged_news = news_count

    def last_departure(self, device: str) -> PresenceChange | None:
        """The latest departure of the device; None if the log has none."""
        return next((change for change in self.log if change.device == device and not change.joined), None)

    def last_arrival(self, device: str) -> PresenceChange | None:
        return next((change for change in self.log if change.device == device and change.joined), None)

"""The neighbours of a Registry: Registries of other owners, or others of the same site, that show each other offers.

Both owners decide what passes. A Registry gives a neighbour only offers that devices published at itself, so that an offer neither goes
round in a circle nor reaches somebody to whom its owner does not give it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any

from msgspec import Struct, structs

from somrs.errors import UsageError
from somrs.kernel.component import Effect, Input, Received
from somrs.kernel.following import LEASE
from somrs.kernel.offers import Offers
from somrs.kernel.service_replica import OffersReading, ServiceReplica, ServiceUpdate
from somrs.ontology.map import Map
from somrs.ontology.qualified_names import SEPARATOR
from somrs.ontology.types import Ontology
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import Discovered, Offer, ServicesJoined, ServicesLeft, SubscribeServices
from somrs.protocol.messages.frp import Fault
from somrs.registry.selection import Selection, Selector

MOST_OFFERS = 10_000
"""How many offers of a neighbour are kept: what another owner sends must not take up all memory."""


class Neighbour(Struct, frozen=True, kw_only=True):
    """A neighbour as its owner configures it: the `address` of its Registry, and which of its offers this Registry `takes` and which of its
    own it `gives`; None: none. `is_of_site`: it is a Registry of the same site, at which devices may publish instead. `map`: the name that
    its owner's map has, if not this one."""

    name: str
    address: str
    takes: Selection | None = None
    gives: Selection | None = None
    is_of_site: bool = False
    map: str = ""

    @property
    def map_name(self) -> str:
        """The name that its owner's map has, if it has one."""
        return self.map or self.name


class Configured(Struct, frozen=True, tag=True):
    """The neighbours from now on, in order of precedence: of two devices with one name, that of the first is listed."""

    neighbours: tuple[Neighbour, ...]


class NeighbourDue(Struct, frozen=True, tag=True):
    """The timer of the copy of a neighbour's offers."""

    name: str


class NeighbourReplica(ServiceReplica, kw_only=True):
    """The copy of the offers that a neighbour gives. `problem`: what it answered last instead of giving them."""

    name: str
    problem: str = ""

    def handle(self, event: Input, now: float) -> ServiceUpdate | None:
        if isinstance(event, Received) and self.subscription is not None and event.message.header.relates_to == self.subscription:
            self.problem = event.message.body.text if isinstance(event.message.body, Fault) else ""
        return super().handle(event, now)

    @property
    def timer(self) -> Any:
        return NeighbourDue(self.name)

    @property
    def complaint(self) -> str:
        """Why not all of its offers are listed: what it answered last instead of giving them, or that it gives too many."""
        return self.problem or (f"only {MOST_OFFERS} of its offers are kept" if len(self.offers) >= MOST_OFFERS else "")

    def _add_page(self, reading: OffersReading, page: Discovered) -> Body | None:
        question = super()._add_page(reading, page)
        del reading.offers[MOST_OFFERS:]
        return question if len(reading.offers) < MOST_OFFERS else None

    def _apply(self, event: ServicesJoined | ServicesLeft, now: float) -> None:
        super()._apply(event, now)
        if len(self.offers) > MOST_OFFERS:
            self.offers = Offers(islice(self.offers, MOST_OFFERS))

    def _subscription(self) -> Body:
        return SubscribeServices(lease=LEASE, neighbour=True)


class NeighbourState(Struct, kw_only=True):
    """A neighbour, and what is known of it. `version`: that of the offers which it is given.

    `since`: when it became a neighbour; `copy`: None if nothing is taken. `is_away`: its offers are left out, because it has not answered.
    """

    settings: Neighbour
    version: int = 0
    since: float = 0.0
    copy: NeighbourReplica | None = None
    is_away: bool = True

    @property
    def answered_at(self) -> float:
        """When it was last heard of, on this Registry's clock; if it never was, when it became a neighbour."""
        return max(self.copy.known_since if self.copy is not None else 0.0, self.since)

    @property
    def away_at(self) -> float | None:
        """When it will be away if it does not answer; None if it is."""
        return None if self.is_away or self.copy is None else self.copy.known_since + LEASE

    def is_silent(self, now: float) -> bool:
        """Whether its latest answer is so old that the subscription has run out, or whether there was none yet."""
        return self.copy is not None and now >= self.copy.known_since + LEASE

    def start(self, now: float) -> list[Effect]:
        """Follow it, if anything is taken from it."""
        self.version, self.since = self.version or int(now * 1000), self.since or now
        return self.copy.start(now) if self.copy is not None else []

    @property
    def offers(self) -> Offers:
        """Its offers as far as known; none while it is away."""
        return self.copy.offers if self.copy is not None and not self.is_away else Offers()


def taken_offers(settings: Neighbour, offers: Iterable[Offer], ontology: Ontology, map: Map | None) -> Iterator[tuple[Offer, str]]:
    """The offers of a neighbour that are taken, as they are listed here, each with the service's name there. What it has from others is not
    taken.

    If the neighbour also has a map of its own, its devices are on this map under qualified names.
    """
    if settings.takes is None:
        return
    qualifier = f"{settings.map_name}{SEPARATOR}" if map is not None and settings.map_name in map.homes else ""
    selector = Selector(settings.takes, ontology, map)
    for offer in offers:
        service, provider = f"{qualifier}{offer.service}", f"{qualifier}{offer.provider}"
        listed_offer = structs.replace(offer, registry=settings.name, service=service, provider=provider)
        if not offer.registry and selector.selects(listed_offer):
            yield listed_offer, offer.service


def check_neighbours(neighbours: Iterable[Neighbour], address: str = "") -> None:
    """Raises UsageError for two neighbours with one name or address, and for one with the address of the Registry itself."""
    known: dict[str, Neighbour] = {}
    for neighbour in neighbours:
        if neighbour.address == address:
            raise UsageError(f"the neighbour {neighbour.name} has the address of this Registry, {address}: give it that of its own")
        for key in (neighbour.name, neighbour.address):
            if (other := known.setdefault(key, neighbour)) is not neighbour:
                raise UsageError(
                    f"the neighbours {other.name} and {neighbour.name} are both {key}: give each a name and an address of its own"
                )

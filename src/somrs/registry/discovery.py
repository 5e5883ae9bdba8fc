"""How a Registry answers the question which services are on offer."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import takewhile

from somrs.entish.formula import Formula
from somrs.entish.parse import parse
from somrs.ontology.map import Map
from somrs.ontology.matching import can_achieve
from somrs.ontology.types import Ontology, Value
from somrs.protocol.messages.directory import Discover, Discovered, NeighbourView, Offer, Withheld
from somrs.protocol.messages.paging import fit_page
from somrs.registry.listing import OWN, Listing, ProviderKey
from somrs.registry.selection import type_names
from somrs.registry.state import RegistryState


class Finder:
    """Finds offers in a listing, as it is now. It has no state of its own."""

    def __init__(self, state: RegistryState, listing: Listing, ontology: Ontology, map: Map | None, now: float) -> None:
        self._state, self._listing, self._ontology, self._map, self._now = state, listing, ontology, map, now

    def discover(self, query: Discover, audience: str = OWN) -> Discovered:
        """A page of what the audience sees. Raises FormulaError for an effect that is no formula."""
        effect = parse(query.effect) if query.effect is not None else None
        present, reasons = [*self._present()], dict[tuple[str, str], Withheld]()
        if audience:
            listed = [offer for key in present for offer in self._listing.offers_of(key)]
            offers = [] if query.withheld else self._listing.given(self._state.neighbours[audience].settings, listed)
        elif query.withheld:
            withheld = [entry for key in present for entry in self._listing.withheld_of(key)]
            offers, reasons = [offer for offer, _ in withheld], {(reason.service, reason.registry): reason for _, reason in withheld}
        else:
            offers = [offer for key in present for offer in self._listing.offers_of(key)]
        fitting = [offer for offer in offers if offer.service > query.after and self._fits(offer, query, effect)]
        later_offers = sorted(fitting, key=lambda offer: offer.service)
        page = [*fit_page(later_offers, len(later_offers))]
        # The next page begins with another service: neighbours may have withheld services of the same name.
        page += takewhile(lambda offer: offer.service == page[-1].service, later_offers[len(page) :])
        pairs = ((offer.service, offer.registry) for offer in page)
        return Discovered(
            offers=tuple(page),
            more=len(page) < len(later_offers),
            withheld=tuple(reasons[pair] for pair in pairs if pair in reasons),
            unsettled=any(self._is_unsettled(key) for key in present),
            version=self._state.version_for(audience),
            neighbours=() if audience else tuple(self._neighbours()),
        )

    def _present(self) -> Iterator[ProviderKey]:
        """The providers whose leases have not run out."""
        state = self._state
        for registry, name in self._listing.keys:
            is_silent = state.neighbours[registry].is_silent(self._now) if registry else state.providers[name].expires_at <= self._now
            if not is_silent:
                yield registry, name

    def _is_unsettled(self, key: ProviderKey) -> bool:
        """Whether the provider is about to publish again."""
        registry, name = key
        if registry == OWN:
            return self._now < (self._state.providers[name].expected_by or 0.0)
        copy = self._state.neighbours[registry].copy
        return copy is not None and any(self._now < time for time in copy.expected.values())

    def _neighbours(self) -> Iterator[NeighbourView]:
        """The neighbours of the site, without its other Registries."""
        for name, neighbour in self._state.neighbours.items():
            if neighbour.copy is None or neighbour.settings.is_of_site:
                continue
            is_silent = neighbour.is_silent(self._now)
            keys = [] if is_silent else [key for key in self._listing.keys if key[0] == name]
            yield NeighbourView(
                name=name,
                address=neighbour.settings.address,
                services=sum(1 for key in keys for _ in self._listing.offers_of(key)),
                away_since=neighbour.answered_at if is_silent else None,
                problem=neighbour.copy.complaint,
            )

    def _fits(self, offer: Offer, query: Discover, effect: Formula | None) -> bool:
        return (
            (query.provider is None or offer.provider == query.provider)
            and (query.service_type is None or query.service_type in type_names(offer.service_type, self._ontology))
            and all(_equal_values(offer.attributes.get(name), value) for name, value in query.attributes.items())
            and (effect is None or can_achieve(offer.service_type, effect, self._ontology, self._map))
        )


def _equal_values(value: Value | None, other_value: Value) -> bool:
    """Whether two values are equal; TRUE is not 1."""
    return value == other_value and isinstance(value, bool) == isinstance(other_value, bool)

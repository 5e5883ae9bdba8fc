"""Which offers the Registry lists, and which it withholds because they disagree about a service type, or because another has their name.

A service type has one definition at a time: that of the Repository. For a type that the Repository does not have, it is that of the
provider that has offered it for the longest time. An offer that agrees with it (`ontology/agreement.py`) is listed with it, so that
planners see one definition; an offer that disagrees is withheld.

Offers of neighbours are listed with those that are published here. A type of theirs that nobody has here must fit the ontology. Names of
devices and services mean one thing: those published here come first, then those of the neighbours in their order.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property

from msgspec import Struct, structs

from somrs.kernel.offers import Offers
from somrs.ontology.agreement import disagreements
from somrs.ontology.consistency import ontology_violations
from somrs.ontology.map import Map
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Ontology
from somrs.protocol.messages.directory import Offer, Withheld
from somrs.registry.neighbours import Neighbour, NeighbourState, taken_offers
from somrs.registry.selection import Selector
from somrs.registry.state import Provider

OWN = ""
"""The name of this Registry, among those of the neighbours."""

ProviderKey = tuple[str, str]
"""The Registry at which a device publishes, OWN or a neighbour, and the device."""

OffersByService = Mapping[str, Offer]

MAX_HOLDERS = 3
"""How many providers a reason names."""


class Views(Struct, frozen=True):
    """What is listed of some `providers` for each audience: for this system, OWN, and for each neighbour to which something is given."""

    providers: tuple[ProviderKey, ...]
    audiences: Mapping[str, OffersByService]


class Listing:
    """The offers of all providers and neighbours, judged by the ontology of the given `version` and by the map.

    A provider that has read a later version knows better than this ontology: its offers are listed as they are.
    """

    def __init__(
        self,
        providers: Mapping[str, Provider],
        ontology: Ontology,
        version: float,
        map: Map | None = None,
        neighbours: Iterable[NeighbourState] = (),
    ) -> None:
        self._providers, self._ontology, self.version, self._map = providers, ontology, version, map
        # These values do not change: the listing stays as it is when the neighbours do not.
        self._neighbours: list[tuple[Neighbour, Offers]] = [(neighbour.settings, neighbour.offers) for neighbour in neighbours]

    def differs(self, old_listing: Listing) -> bool:
        """Whether another listing of the same providers may judge an offer in another way."""
        if self._ontology is not old_listing._ontology:
            return True
        if self._map is not old_listing._map and (self._has_areas or self._maps_of_neighbours != old_listing._maps_of_neighbours):
            return True
        low, high = sorted((self.version, old_listing.version))
        return any(low < provider.ontology_version <= high for provider in self._providers.values())

    @property
    def _maps_of_neighbours(self) -> set[str]:
        """The neighbours whose maps are on the map: their devices have qualified names."""
        maps = {neighbour.map_name for neighbour, _ in self._neighbours}
        return {name for name in maps if self._map is not None and name in self._map.homes}

    @property
    def _has_areas(self) -> bool:
        """Whether it depends on the map."""
        selections = (selection for neighbour, _ in self._neighbours for selection in (neighbour.takes, neighbour.gives))
        return any(selection is not None and selection.areas for selection in selections)

    @cached_property
    def _taken(self) -> dict[str, dict[str, Offer]]:
        """What is taken from each neighbour, by the names that the services have there."""
        return {
            neighbour.name: {service: offer for offer, service in taken_offers(neighbour, offers, self._ontology, self._map)}
            for neighbour, offers in self._neighbours
        }

    def taken_from(self, neighbour: str) -> OffersByService:
        """What is taken from a neighbour, listed or withheld, by the names that the services have there."""
        return self._taken[neighbour]

    @cached_property
    def _sources(self) -> dict[str, Mapping[str, Provider]]:
        """The providers by the Registry at which they publish, in order of precedence."""
        sources: dict[str, Mapping[str, Provider]] = {OWN: self._providers}
        for name, offers in self._taken.items():
            providers: dict[str, Provider] = {}
            for offer in offers.values():
                providers.setdefault(offer.provider, Provider(offers={}, expires_at=0.0)).offers[offer.service] = offer
            sources[name] = providers
        return sources

    @property
    def keys(self) -> list[ProviderKey]:
        """All providers."""
        return [(registry, name) for registry, providers in self._sources.items() for name in providers]

    def views(self, keys: Iterable[ProviderKey]) -> Views:
        """What is listed of these providers."""
        providers = tuple(dict.fromkeys(keys))
        listed = {offer.service: offer for key in providers for offer in self.offers_of(key)}
        audiences = {OWN: listed}
        for neighbour, _ in self._neighbours:
            audiences[neighbour.name] = {offer.service: offer for offer in self.given(neighbour, listed.values())}
        return Views(providers, audiences)

    def given(self, neighbour: Neighbour, offers: Iterable[Offer]) -> list[Offer]:
        """Those of the offers that the neighbour is given."""
        if neighbour.gives is None:
            return []
        selector = Selector(neighbour.gives, self._ontology, self._map)
        return [offer for offer in offers if offer.registry == OWN and selector.selects(offer)]

    def publishes(self, offer: Offer) -> bool:
        """Whether a provider offers the service, listed or withheld, where the offer comes from."""
        provider = self._sources.get(offer.registry, {}).get(offer.provider)
        return provider is not None and offer.service in provider.offers

    def offers_of(self, key: ProviderKey) -> Iterator[Offer]:
        """The listed offers of a provider."""
        for offer in self._offers(key):
            if self._objections(key, offer):
                continue
            definition = self._definition(key, offer)
            if offer.service_type == definition:
                yield offer
            elif not disagreements(offer.service_type, definition, provides=True):
                yield structs.replace(offer, service_type=definition)

    def withheld_of(self, key: ProviderKey) -> Iterator[tuple[Offer, Withheld]]:
        """The other offers of a provider, with the reasons."""
        for offer in self._offers(key):
            if reason := self._objections(key, offer):
                yield offer, Withheld(service=offer.service, reason=reason, registry=key[0])
            elif reasons := disagreements(offer.service_type, self._definition(key, offer), provides=True):
                yield offer, Withheld(service=offer.service, reason=self._reason(offer.service_type.name, reasons), registry=key[0])

    def _offers(self, key: ProviderKey) -> list[Offer]:
        registry, name = key
        # What is published here does not depend on neighbours.
        provider = (self._providers if registry == OWN else self._sources.get(registry, {})).get(name)
        return [*provider.offers.values()] if provider is not None else []

    def _definition(self, key: ProviderKey, offer: Offer) -> ServiceType:
        """The definition by which an offer is judged."""
        if key[0] == OWN and self._providers[key[1]].ontology_version > self.version:
            return offer.service_type
        type_name = offer.service_type.name
        return self._ontology.services.get(type_name) or self._own_types[type_name]

    @cached_property
    def _own_types(self) -> dict[str, ServiceType]:
        """The types on offer that the ontology does not have, each as its first provider defines it."""
        types: dict[str, ServiceType] = {}
        for providers in self._sources.values():
            for provider in providers.values():
                for offer in provider.offers.values():
                    if offer.service_type.name not in self._ontology.services:
                        types.setdefault(offer.service_type.name, offer.service_type)
        return types

    def _reason(self, type_name: str, reasons: tuple[str, ...]) -> str:
        offers = (offer for key in sorted(self.keys) for offer in self.offers_of(key))
        holders = [offer.provider for offer in offers if offer.service_type.name == type_name]
        known = type_name in self._ontology.services
        offered = f"{_names(holders)} offer{'s' if len(holders) == 1 else ''} it so" if holders else ""
        source = "the Repository defines it otherwise" if known else "another provider defines it otherwise"
        remedy = "offer it as the Repository defines it, change it there for all devices" if known else "offer it as they do"
        return f"{type_name}: {'; '.join(reasons)}: {source}{f', and {offered}' if offered else ''}; {remedy}, or give it another name"

    # Offers of neighbours

    def _objections(self, key: ProviderKey, offer: Offer) -> str:
        """Why an offer of a neighbour is not listed, whatever others define; empty if nothing is against it."""
        registry, name = key
        if registry == OWN:
            return ""
        for other_registry, providers in self._sources.items():
            if other_registry == registry:
                break
            provider = providers.get(name)
            other = next(iter(provider.offers.values())) if provider is not None else self._services[other_registry].get(offer.service)
            if other is not None:
                return _name_conflict(offer, other)
        return self._unusable_types.get(offer.service_type.name, "") if offer.service_type.name not in self._ontology.services else ""

    @cached_property
    def _services(self) -> dict[str, OffersByService]:
        """The offers by service, for each Registry at which they are published."""
        return {
            registry: {service: offer for provider in providers.values() for service, offer in provider.offers.items()}
            for registry, providers in self._sources.items()
        }

    @cached_property
    def _unusable_types(self) -> dict[str, str]:
        """Why nothing can be planned with types that only neighbours define: they refer to what the ontology here does not have."""
        reasons: dict[str, str] = {}
        for name, service_type in self._own_types.items():
            if not any(offer.service_type.name == name for offer in self._services[OWN].values()):
                # Ancestors matter to those who look for services by type only.
                alone = structs.replace(service_type, parent=None)
                violations = ontology_violations(self._ontology.extended([alone]), [alone])
                if violations:
                    problems = "; ".join(violation.message.partition("\n")[0] for violation in violations)
                    reasons[name] = f"{name} does not fit the definitions of the Repository: {problems}; define there what it needs"
        return reasons

    def rivals(self, offers: Iterable[Offer]) -> set[ProviderKey]:
        """The providers whose listed offers may depend on these offers: by their names, or as the ontology lacks their types."""
        offers = [*offers]
        types = {offer.service_type.name for offer in offers} - self._ontology.services.keys()
        rivals = {
            key
            for key in (self.keys if types else ())
            if any(offer.service_type.name in types for offer in self._sources[key[0]][key[1]].offers.values())
        }
        if self._neighbours and offers:
            providers, services = {offer.provider for offer in offers}, {offer.service for offer in offers}
            for registry, known_offers in self._services.items():
                rivals |= {(registry, name) for name in providers & self._sources[registry].keys()}
                rivals |= {(registry, known_offers[service].provider) for service in services & known_offers.keys()}
        return rivals


def _name_conflict(offer: Offer, other: Offer) -> str:
    place = f"at {other.registry}" if other.registry else "here"
    if other.address == offer.address:
        return f"{offer.provider} is listed as it is published {place}"
    name = offer.provider if offer.provider == other.provider else offer.service
    return f"{name} of {offer.registry} has the name of another {place}: give one of the two another name"


def _names(names: list[str]) -> str:
    distinct = [*dict.fromkeys(names)]
    if len(distinct) > MAX_HOLDERS:
        distinct[MAX_HOLDERS:] = [f"{len(distinct) - MAX_HOLDERS} more"]
    return " and ".join(filter(None, [", ".join(distinct[:-1]), distinct[-1]]))

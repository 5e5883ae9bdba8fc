"""Which offers the Registry lists, and which it withholds because they disagree about a service type.

A service type has one definition at a time: that of the Repository. For a type that the Repository does not have, it is that of the
provider that has offered it for the longest time. An offer that agrees with it (`ontology/agreement.py`) is listed with it, so that
planners see one definition; an offer that disagrees is withheld.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property

from msgspec import structs

from somrs.ontology.agreement import disagreements
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Ontology
from somrs.protocol.messages.directory import Offer, Withheld
from somrs.registry.state import Provider

ListedOffers = Mapping[str, Mapping[str, Offer]]
"""The listed offers by provider and service."""

MAX_HOLDERS = 3
"""How many providers a reason names."""


class Listing:
    """The offers of all providers, judged by the ontology of the given `version`.

    A provider that has read a later version knows better than this ontology: its offers are listed as they are.
    """

    def __init__(self, providers: Mapping[str, Provider], ontology: Ontology, version: float) -> None:
        self._providers, self._ontology, self.version = providers, ontology, version

    def differs(self, old_listing: Listing) -> bool:
        """Whether another listing of the same providers may judge an offer in another way."""
        if self._ontology is not old_listing._ontology:
            return True
        low, high = sorted((self.version, old_listing.version))
        return any(low < provider.ontology_version <= high for provider in self._providers.values())

    def listed(self, names: Iterable[str]) -> ListedOffers:
        """The listed offers of these providers."""
        return {name: {offer.service: offer for offer in self.offers_of(name)} for name in names}

    def offers_of(self, name: str) -> Iterator[Offer]:
        """The listed offers of a provider."""
        for offer in self._offers(name):
            definition = self._definition(name, offer)
            if offer.service_type == definition:
                yield offer
            elif not disagreements(offer.service_type, definition, provides=True):
                yield structs.replace(offer, service_type=definition)

    def withheld_of(self, name: str) -> Iterator[tuple[Offer, Withheld]]:
        """The other offers of a provider, with the reasons."""
        for offer in self._offers(name):
            definition = self._definition(name, offer)
            if reasons := disagreements(offer.service_type, definition, provides=True):
                yield offer, Withheld(service=offer.service, reason=self._reason(offer.service_type.name, reasons))

    def _offers(self, name: str) -> list[Offer]:
        provider = self._providers.get(name)
        return [*provider.offers.values()] if provider is not None else []

    def _definition(self, name: str, offer: Offer) -> ServiceType:
        """The definition by which an offer is judged."""
        if self._providers[name].ontology_version > self.version:
            return offer.service_type
        type_name = offer.service_type.name
        return self._ontology.services.get(type_name) or self._own_types[type_name]

    @cached_property
    def _own_types(self) -> dict[str, ServiceType]:
        """The types on offer that the ontology does not have, each as its first provider defines it."""
        types: dict[str, ServiceType] = {}
        for provider in self._providers.values():
            for offer in provider.offers.values():
                if offer.service_type.name not in self._ontology.services:
                    types.setdefault(offer.service_type.name, offer.service_type)
        return types

    def _reason(self, type_name: str, reasons: tuple[str, ...]) -> str:
        offers = (offer for name in sorted(self._providers) for offer in self.offers_of(name))
        holders = [offer.provider for offer in offers if offer.service_type.name == type_name]
        known = type_name in self._ontology.services
        offered = f"{_names(holders)} offer{'s' if len(holders) == 1 else ''} it so" if holders else ""
        source = "the Repository defines it otherwise" if known else "another provider defines it otherwise"
        remedy = "offer it as the Repository defines it, change it there for all devices" if known else "offer it as they do"
        return f"{type_name}: {'; '.join(reasons)}: {source}{f', and {offered}' if offered else ''}; {remedy}, or give it another name"

    def rivals(self, offers: Iterable[Offer]) -> set[str]:
        """The providers whose listed offers may depend on these offers, because the ontology does not have their types."""
        names = {offer.service_type.name for offer in offers} - self._ontology.services.keys()
        if not names:
            return set()
        return {
            name
            for name, provider in self._providers.items()
            if any(offer.service_type.name in names for offer in provider.offers.values())
        }


def _names(names: list[str]) -> str:
    distinct = [*dict.fromkeys(names)]
    if len(distinct) > MAX_HOLDERS:
        distinct[MAX_HOLDERS:] = [f"{len(distinct) - MAX_HOLDERS} more"]
    return " and ".join(filter(None, [", ".join(distinct[:-1]), distinct[-1]]))

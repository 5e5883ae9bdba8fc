"""The offers of services that a component knows, by name, by type and by device."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import cached_property

from msgspec import structs

from somrs.ontology.services import ServiceType
from somrs.protocol.messages.directory import Offer


class Offers(Collection[Offer]):
    """Offers, in the order of their services' names. They do not change: `changed` returns others. Indexes are built when they are used."""

    def __init__(self, offers: Iterable[Offer] = ()) -> None:
        self._by_service = {offer.service: offer for offer in sorted(_with_shared_types(offers), key=lambda offer: offer.service)}

    def __len__(self) -> int:
        return len(self._by_service)

    def __iter__(self) -> Iterator[Offer]:
        return iter(self._by_service.values())

    def __contains__(self, offer: object) -> bool:
        return isinstance(offer, Offer) and self._by_service.get(offer.service) == offer

    def __eq__(self, other: object) -> bool:
        return self._by_service == other._by_service if isinstance(other, Offers) else NotImplemented

    __hash__ = None  # type: ignore[assignment]  # offers have attributes, which are dictionaries

    def __repr__(self) -> str:
        return f"Offers({[*self._by_service]})"

    def get(self, service: str) -> Offer | None:
        """The offer of a service."""
        return self._by_service.get(service)

    def of_services(self, services: Iterable[str]) -> list[Offer]:
        """The offers of these services, as far as they are on offer."""
        return [offer for service in sorted({*services}) if (offer := self.get(service)) is not None]

    def of_provider(self, provider: str) -> list[Offer]:
        """The offers of a device."""
        return [*self._by_provider.get(provider, ())]

    def changed(self, added_offers: Iterable[Offer] = (), removed_services: Iterable[str] = ()) -> Offers:
        """These offers without those of some services, and then with others, which replace those of the same service."""
        offers = dict(self._by_service)
        for service in removed_services:
            offers.pop(service, None)
        offers.update({offer.service: offer for offer in added_offers})
        return Offers(offers.values())

    def of_types(self, names: Iterable[str]) -> list[Offer]:
        """The offers of the service types with these names."""
        offers = [offer for name in dict.fromkeys(names) for offer in self._by_type.get(name, ())]
        return sorted(offers, key=lambda offer: offer.service)

    @cached_property
    def _by_type(self) -> dict[str, list[Offer]]:
        offers: dict[str, list[Offer]] = {}
        for offer in self:
            offers.setdefault(offer.service_type.name, []).append(offer)
        return offers

    @cached_property
    def _by_provider(self) -> dict[str, list[Offer]]:
        offers: dict[str, list[Offer]] = {}
        for offer in self:
            offers.setdefault(offer.provider, []).append(offer)
        return offers

    @property
    def providers(self) -> Collection[str]:
        """The devices whose services are on offer."""
        return self._by_provider.keys()

    @cached_property
    def types(self) -> Mapping[str, ServiceType]:
        """The service types on offer by name; if offers disagree, as the last one defines it."""
        return {name: offers[-1].service_type for name, offers in self._by_type.items()}

    @cached_property
    def definitions(self) -> tuple[ServiceType, ...]:
        """All definitions of service types on offer: of one type several, while offers disagree about it."""
        definitions: dict[str, list[ServiceType]] = {}
        for offer in self:
            known = definitions.setdefault(offer.service_type.name, [])
            if not any(definition is offer.service_type or definition == offer.service_type for definition in known):
                known.append(offer.service_type)
        return tuple(definition for known in definitions.values() for definition in known)


def _with_shared_types(offers: Iterable[Offer]) -> Iterator[Offer]:
    """The offers with one object for equal definitions: each message brings its own."""
    known_types: dict[str, ServiceType] = {}
    for offer in offers:
        known_type = known_types.setdefault(offer.service_type.name, offer.service_type)
        is_copy = known_type is not offer.service_type and known_type == offer.service_type
        yield structs.replace(offer, service_type=known_type) if is_copy else offer

"""The bodies of the Service Registry's protocol: the offers of services and their leases."""

from __future__ import annotations

from msgspec import Struct

from somrs.ontology.services import ServiceType
from somrs.ontology.types import Value
from somrs.protocol.messages.body import MessageBody

CAPACITY_ATTRIBUTE = "AtOnce"
"""The attribute with the number of services that a device performs at the same time; without it, one."""
UNOCCUPIED = 0
"""The value of this attribute for a service that a device performs beside all others, such as an answer to a question."""

REPUBLISHING_TIME = 3.0
"""Seconds within which a provider is expected to publish again when service types are defined anew."""

RETRACTED = "retracted"
"""The reason why services left that are not offered any more."""
OUTDATED = "outdated"
"""The reason why services left whose types are defined anew."""
AWAY = "away"
"""The reason why services of a neighbour left that has not answered for too long."""
WITHHELD = "withheld"
"""The reason why services of a neighbour left that are withheld: others here have their names, or their types are defined otherwise."""


class Offer(Struct, frozen=True, kw_only=True):
    """One service of one device.

    `service` is its name in the whole system (`Robot1.TransferObject`), `provider` the device's object on the map, `address` that of its
    Service Manager. `attributes` are such as the operation range and the price. `registry`: the neighbour whose Registry lists it, by the
    name that it has at the Registry that answers; empty: that Registry itself.
    """

    service: str
    provider: str
    provider_type: str
    address: str
    service_type: ServiceType
    attributes: dict[str, Value] = {}
    registry: str = ""

    @property
    def capacity(self) -> float:
        """How many services that occupy it the device performs at the same time."""
        value = self.attributes.get(CAPACITY_ATTRIBUTE, 1)
        return value if isinstance(value, int | float) and not isinstance(value, bool) else 1

    @property
    def occupies(self) -> bool:
        """Whether the service occupies its device, so that it has to wait for others."""
        return self.capacity != UNOCCUPIED


class Publish(MessageBody, frozen=True, kw_only=True, tag=True):
    """Offer these services for `lease` seconds. A repeated Publish renews the lease and replaces the provider's offers.

    `ontology_version`: the version of the Repository from which the provider has the definitions of the service types; 0: not known.
    """

    provider: str
    offers: tuple[Offer, ...]
    lease: float
    ontology_version: int = 0


class Withheld(Struct, frozen=True, kw_only=True):
    """A service that is published and not listed: the definition of its type disagrees with the one in use, or another has its name.

    `registry`: as in Offer.
    """

    service: str
    reason: str
    registry: str = ""


class NeighbourView(Struct, frozen=True, kw_only=True):
    """A neighbour whose offers a Registry lists with its own. `services`: how many of its services are listed now.

    `away_since`: when it last answered, in seconds since 1970, if that is so long ago that its services are left out; None if it is there.
    `problem`: why it gives nothing, in its own words.
    """

    name: str
    address: str
    services: int
    away_since: float | None = None
    problem: str = ""


class Published(MessageBody, frozen=True, kw_only=True, tag=True):
    """The offers are kept until `until`, on the Registry's clock; renew the lease at least every `renew_within` seconds.

    Clients do not see the services in `withheld`: read the definitions of their types in the Repository, and publish again.
    `other_registries`: the addresses of those of the site; publish at one of them if this one does not answer.
    """

    until: float
    renew_within: float
    withheld: tuple[Withheld, ...] = ()
    other_registries: tuple[str, ...] = ()


class ServiceTypesChanged(MessageBody, frozen=True, kw_only=True, tag=True):
    """To a provider: these service types are defined anew, so that its offers of them are withheld. It should read the definitions in the
    Repository, and publish again. There is no answer."""

    provider: str
    service_types: tuple[str, ...]


class Renew(MessageBody, frozen=True, kw_only=True, tag=True):
    """Renew the lease. The answer is Published, or a Fault when the Registry does not know the provider."""

    provider: str
    lease: float


class Retract(MessageBody, frozen=True, kw_only=True, tag=True):
    """Withdraw the named services of a provider, or all."""

    provider: str
    services: tuple[str, ...] = ()


class Retracted(MessageBody, frozen=True, kw_only=True, tag=True):
    services: tuple[str, ...]


class Discover(MessageBody, frozen=True, kw_only=True, tag=True):
    """Find the services that match all given criteria.

    The criteria are a service type (with its sub-types), a provider, equal attributes, and a formula that the service's effect can make
    true. `after` is the last service of the page before. `withheld`: find the services that are published and not listed, in their place.
    """

    service_type: str | None = None
    provider: str | None = None
    attributes: dict[str, Value] = {}
    effect: str | None = None
    after: str = ""
    withheld: bool = False


class Discovered(MessageBody, frozen=True, kw_only=True, tag=True):
    """The offers, by the names of the services. `more`: another page follows. `withheld`: why these offers are not listed.

    `unsettled`: service types are defined anew, and their providers are about to publish again: ask again in a moment. `version`: that of
    the offers listed. `neighbours`: whose offers are listed as well.
    """

    offers: tuple[Offer, ...]
    more: bool = False
    withheld: tuple[Withheld, ...] = ()
    unsettled: bool = False
    version: int = 0
    neighbours: tuple[NeighbourView, ...] = ()


class SubscribeServices(MessageBody, frozen=True, kw_only=True, tag=True):
    """Report to the sender, for `lease` seconds, which services join and leave.

    `neighbour`: the sender is the Registry of a neighbour, which is told what it is given. The answer is a Fault if it is given nothing.
    """

    lease: float
    neighbour: bool = False


class ServicesSubscribed(MessageBody, frozen=True, kw_only=True, tag=True):
    """`version`: that of the offers listed. Unasked, after a restart of the Registry: news may be missing, subscribe again.

    `other_registries`: the addresses of the other Registries of the site, which list the same offers. `away`: the neighbours that do not
    answer, so that their offers are left out.
    """

    until: float
    version: int = 0
    other_registries: tuple[str, ...] = ()
    away: tuple[str, ...] = ()


class ServicesJoined(MessageBody, frozen=True, kw_only=True, tag=True):
    """To subscribers: these offers are listed now, or are listed as they are here.

    `version`: that of the offers listed, which each notification increases by 1. A gap between versions means that a message was lost: read
    the offers again.
    """

    offers: tuple[Offer, ...]
    version: int = 0


class ServicesLeft(MessageBody, frozen=True, kw_only=True, tag=True):
    """To subscribers: services left. `reason`: retracted, expired (the lease was not renewed), outdated (their types are defined anew),
    away or withheld (services of a neighbour).

    `version`: as in ServicesJoined.
    """

    services: tuple[str, ...]
    provider: str
    reason: str
    version: int = 0


class PresenceChange(Struct, frozen=True, kw_only=True):
    """The arrival (`joined`) or departure of services of a device. `at`: seconds since 1970; `reason`: as in ServicesLeft;
    `registry`: as in Offer."""

    at: float
    device: str
    services: tuple[str, ...]
    joined: bool
    reason: str = ""
    registry: str = ""


class ReadPresence(MessageBody, frozen=True, kw_only=True, tag=True):
    """Read which devices joined and left recently."""


class PresenceLog(MessageBody, frozen=True, kw_only=True, tag=True):
    """The latest arrivals and departures, newest first: as many as the Registry keeps, and as fit into one message."""

    changes: tuple[PresenceChange, ...]

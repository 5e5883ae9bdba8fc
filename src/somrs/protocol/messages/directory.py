"""The bodies of the Service Registry's protocol: who offers what, until when."""

from __future__ import annotations

from msgspec import Struct

from somrs.ontology.services import ServiceType
from somrs.ontology.types import Value
from somrs.protocol.messages.body import MessageBody

CAPACITY_ATTRIBUTE = "AtOnce"
"""The attribute of a service whose device performs several services at the same time: so many. Without it, one at a time."""


class Offer(Struct, frozen=True, kw_only=True):
    """One service of one device. `service` is its name in the whole system (`Robot1.TransferObject`), `provider` the
    device's object in the map, `address` where its Service Manager listens. `attributes`: operation range, price, ..."""

    service: str
    provider: str
    provider_type: str
    address: str
    service_type: ServiceType
    attributes: dict[str, Value] = {}


class Publish(MessageBody, frozen=True, kw_only=True, tag=True):
    """Offer these services for `lease` seconds. Publishing again renews, and replaces what the provider offered."""

    provider: str
    offers: tuple[Offer, ...]
    lease: float


class Published(MessageBody, frozen=True, kw_only=True, tag=True):
    """Kept until `until`, on the Registry's clock; renew at the latest every `renew_within` seconds."""

    until: float
    renew_within: float


class Renew(MessageBody, frozen=True, kw_only=True, tag=True):
    """Still there: another lease. Answered by Published, or by a Fault when the Registry does not know the provider."""

    provider: str
    lease: float


class Retract(MessageBody, frozen=True, kw_only=True, tag=True):
    """Withdraw a provider's services: those named, or all."""

    provider: str
    services: tuple[str, ...] = ()


class Retracted(MessageBody, frozen=True, kw_only=True, tag=True):
    services: tuple[str, ...]


class Discover(MessageBody, frozen=True, kw_only=True, tag=True):
    """Which services fit all that is given: a service type (its sub-types included), a provider, equal attributes, and a
    formula that the service's effect can make true. `after` is the last service of the page before."""

    service_type: str | None = None
    provider: str | None = None
    attributes: dict[str, Value] = {}
    effect: str | None = None
    after: str = ""


class Discovered(MessageBody, frozen=True, kw_only=True, tag=True):
    """In the order of the services' names; `more` says whether another page follows."""

    offers: tuple[Offer, ...]
    more: bool = False


class SubscribeServices(MessageBody, frozen=True, kw_only=True, tag=True):
    """Tell the sender who comes and goes, for `lease` seconds."""

    lease: float


class ServicesSubscribed(MessageBody, frozen=True, kw_only=True, tag=True):
    until: float


class ServicesJoined(MessageBody, frozen=True, kw_only=True, tag=True):
    offers: tuple[Offer, ...]


class ServicesLeft(MessageBody, frozen=True, kw_only=True, tag=True):
    """`reason`: retracted, or expired (the device fell silent)."""

    services: tuple[str, ...]
    provider: str
    reason: str

"""What one task knows about services, as a part of its state. `available_services.py` judges by it."""

from __future__ import annotations

from msgspec import Struct

from somrs.ontology.services import ServiceType
from somrs.protocol.messages.directory import Offer


class KnownServices(Struct, kw_only=True):
    """What one task knows about services.

    `offers`: what it discovered itself, in the journal of a program that did so for each task; otherwise None.
    """

    offers: tuple[Offer, ...] | None = None
    broken: dict[str, str] = {}
    """Services that failed or refused in this task, and why: new plans leave them out."""
    unable: set[str] = set()
    """Those of them that refused for good, or reported the same impossible situation twice."""
    silent: set[str] = set()
    """Those of them that fell silent, and have not been heard of since."""
    unoffered: tuple[str, ...] = ()
    """The service types that the latest plan lacked, because no device offered them."""
    failures: dict[str, int] = {}
    """The failures that each service has reported since it last completed a step."""
    impossible: dict[str, str] = {}
    """Why the last impossible report of each service was rejected."""
    fruitless: set[tuple[str, str]] = set()
    """Devices and uses of services (as `Step.use`) that told nothing in this task. They are not asked for the same again."""
    told: set[str] = set()
    """The uses of services that told something in this task."""
    types: dict[str, ServiceType] = {}
    """The types of all offers so far. A type outlasts its offers, because a service may be committed to a step of it."""
    common_types: dict[str, ServiceType] = {}
    """The types of the latest offers as the ontology defined them then."""

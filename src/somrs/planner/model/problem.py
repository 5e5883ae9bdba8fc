"""What the planner is asked: bring this about, on this map, with the services that are on offer."""

from __future__ import annotations

from msgspec import Struct, field

from somrs.entish import Formula
from somrs.ontology.objects import Map
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Ontology
from somrs.planner.model.plan import Step


class AvailableService(Struct, frozen=True):
    """A service type that can be used now, and the devices (objects of the map, if they are on it) that offer it. `prices` are what
    some of them asked for it last."""

    service_type: ServiceType
    providers: tuple[str, ...]
    prices: tuple[tuple[str, float], ...] = ()


class LostService(Struct, frozen=True):
    """A service that is on offer, but not to this task any more, and why: it refused, failed, or fell silent."""

    service_type: ServiceType
    service: str
    reason: str = field(name="why")


class Problem(Struct, frozen=True, kw_only=True, tag=True):
    """A task as the planner sees it.

    `goal` may have variables (any binding will do) and OR. `precondition` is what the client says is so at the start.
    `excluded` are objects that no step may involve: promised to another task, or in a state that nobody knows.
    `rest` is what was still to do of the plan before, in an order, when it has to be planned anew; to those `promised`, by id, services
    are committed. `hurry`: of two plans the one that is done sooner is better, not the cheaper one. `lost` services are not planned with,
    but are spoken of when there is no plan without them.
    """

    ontology: Ontology
    map: Map
    goal: Formula
    services: tuple[AvailableService, ...] = ()
    precondition: Formula | None = None
    excluded: frozenset[str] = frozenset()
    rest: tuple[Step, ...] = ()
    promised: frozenset[str] = frozenset()
    hurry: bool = False
    lost: tuple[LostService, ...] = ()

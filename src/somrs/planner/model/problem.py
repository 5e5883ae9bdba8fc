"""The planner's input: a goal, a map, and the services on offer."""

from __future__ import annotations

from collections.abc import Iterable

from msgspec import Struct, field

from somrs.entish import Formula, Term
from somrs.ontology.map import Map
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Ontology
from somrs.planner.model.plan import Step
from somrs.planner.model.reading import Reading


class AvailableService(Struct, frozen=True):
    """A service type that is on offer, with the names of the devices that offer it. `prices` holds the latest prices, in euros, of those
    devices that have quoted one."""

    service_type: ServiceType
    providers: tuple[str, ...]
    prices: tuple[tuple[str, float], ...] = ()


class LostService(Struct, frozen=True):
    """A service that this task can no longer use, and why: it refused, failed, or stopped responding."""

    service_type: ServiceType
    service: str
    reason: str = field(name="why")


def rejection_text(services: Iterable[LostService]) -> str:
    """What is to be said after a statement about services whose reports the Repository rejected; nothing if there are none."""
    texts = [f"the Repository rejects what {loss.service} reports ({loss.reason}); if it is so, change the ontology" for loss in services]
    return f": {', and '.join(texts)}" if texts else ""


class StepBid(Struct, frozen=True, kw_only=True):
    """The answer of a service that was asked for a step of an earlier plan: a service type and its inputs.

    `condition`: the service does it only if this holds at the start (None: in any case). `refuses`: not even then. `price` is None if it is
    not known.
    """

    service_type: str
    inputs: tuple[tuple[str, Term], ...]
    provider: str
    service: str
    condition: Formula | None = None
    price: float | None = None
    refuses: bool = False


class Problem(Struct, frozen=True, kw_only=True, tag=True):
    """A planning problem.

    `goal` may have OR and variables, for which any binding is accepted. `precondition` is a condition of the client that must hold at the
    start. `excluded` are objects that no step may involve: another task has reserved them, or their state is unknown. When a task is
    replanned, `rest` holds the steps of the previous plan that are still to do, in an order of execution, and `promised` the ids of those
    that services are committed to. `hurry`: a plan that is done sooner is better than a cheaper one. `lost` services are not planned
    with; the explanation names them when there is no plan without them.
    """

    ontology: Ontology
    map: Map
    goal: Formula
    services: tuple[AvailableService, ...] = ()
    precondition: Formula | None = None
    excluded: frozenset[str] = frozenset()
    unknown: frozenset[str] = frozenset()
    """The excluded objects whose state is unknown; other tasks have reserved the others."""
    fruitless: frozenset[tuple[str, str]] = frozenset()
    """Devices and uses of services (as `Step.use`) that told nothing a short time ago. They are not planned for again."""
    recognises: bool = False
    """The client asks whether, and for which objects, the goal holds. Nothing is to be changed (`recognition.py`)."""
    observed: frozenset[str] = frozenset()
    """The uses of services that have told something in this task."""
    reading: Reading | None = None
    """What the planner assumes beyond the map; None: nothing."""
    rest: tuple[Step, ...] = ()
    promised: frozenset[str] = frozenset()
    hurry: bool = False
    most_plans: int = 1
    """How many plans are wanted. Beyond the first, they are sought only if that is easy."""
    explained: bool = True
    """Whether it is wanted why there is no plan, which may take longer than to find that out."""
    lost: tuple[LostService, ...] = ()
    rejected: tuple[LostService, ...] = ()
    """Services whose last report was one that the map cannot take, and why."""
    resting: tuple[LostService, ...] = ()
    """Services of devices that an operator lets begin no work, and why: they are out of service, for example."""
    bids: tuple[StepBid, ...] = ()
    """Answers of services that concern the plan, because one of those that were asked for the same stated a condition."""

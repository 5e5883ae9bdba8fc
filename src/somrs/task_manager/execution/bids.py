"""Who is asked for a step, and whose Terms are taken (paper, "SO-MRS architecture": Arrangement)."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

from msgspec import Struct
from msgspec.structs import replace

from somrs.entish import Formula
from somrs.entish.formula import conjunction, conjuncts, names, substitute
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.objects import Map
from somrs.ontology.services import ServiceType
from somrs.ontology.truth import bindings, formula_holds
from somrs.ontology.types import Ontology
from somrs.planner.model.plan import Step
from somrs.protocol.messages.clients import Policy, Submit
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.frp import Terms
from somrs.task_manager.context import Interval


class Bid(Struct, frozen=True, kw_only=True):
    """Terms that a service gave, with when it would start and finish (seconds, the coordinator's clock)."""

    participant: str
    terms: Terms
    terms_id: str
    start: float
    finish: float


def make_bid(participant: str, terms: Terms, terms_id: str, earliest: float) -> Bid:
    """The bid that Terms are, for a step that can start at `earliest`."""
    start = max(earliest, terms.start_from or earliest)
    return Bid(participant=participant, terms=terms, terms_id=terms_id, start=start, finish=start + terms.duration)


def fit_bid(bid: Bid, busy: Iterable[Interval]) -> Bid:
    """The bid, later if need be: after whatever the device has been committed to since it gave its terms."""
    start, length = bid.start, bid.finish - bid.start
    for begins, ends in sorted(busy):
        if start < ends and start + length > begins:
            start = ends
    return replace(bid, start=start, finish=start + length)


def choose_bid(bids: Sequence[Bid], task: Submit, now: float) -> Bid:
    """The bid that the task's policy prefers; the participant's name settles what is left equal."""

    def preference(bid: Bid) -> tuple[float, float, str]:
        match task.policy:
            case Policy.PRICE:
                return bid.terms.price, bid.finish, bid.participant
            case Policy.TIME:
                return bid.finish, bid.terms.price, bid.participant
            case Policy.WEIGHTED:
                return bid.terms.price + task.time_value * (bid.finish - now), bid.finish, bid.participant

    return min(bids, key=preference)


def service_types(ontology: Ontology, offers: Iterable[Offer]) -> dict[str, ServiceType]:
    """Every service type known: the ontology's, and those that come with offers."""
    return {**ontology.services, **{offer.service_type.name: offer.service_type for offer in offers}}


def able_offers(step: Step, offers: Sequence[Offer], types_by_name: dict[str, ServiceType], excluded: Collection[str]) -> list[Offer]:
    """The services that can be asked for the step: of its type or a sub-type, of its provider or one alike if the plan names one, and
    not among those that failed or refused it."""

    def is_of_type(name: str | None) -> bool:
        visited: set[str] = set()
        while name is not None and name not in visited:
            if name == step.service_type:
                return True
            visited.add(name)
            name = types_by_name[name].parent if name in types_by_name else None
        return False

    return [
        offer
        for offer in offers
        if is_of_type(offer.service_type.name)
        and (step.provider in (None, offer.provider) or offer.provider in step.alternative_providers)
        and offer.service not in excluded
    ]


def precondition_now(step: Step, service_type: ServiceType, map: Map, ontology: Ontology) -> Formula | None:
    """The step's precondition as the map makes it true now; the step's inputs stay, what they leave open is found anew.

    Raises LookupError when the map does not make it true at all. A service type without precondition gives None.
    """
    if service_type.precondition is None:
        return None
    precondition = substitute(parse(service_type.precondition), step.bindings)
    try:
        binding = next(iter(bindings(precondition, map, ontology)), None)
    except FormulaError as error:
        raise LookupError(str(error)) from error
    if binding is None:
        raise LookupError(f"{precondition} does not hold")
    return substitute(precondition, binding)


def relevant_situation(step: Step, situation: Formula | None, map: Map, ontology: Ontology) -> Formula | None:
    """What a situation says of the step's inputs, as far as it is still so: a failed service tells more than the next one
    needs to know, and others work on the same map."""
    if situation is None:
        return None
    inputs = {name for term in step.inputs.values() for name in names(term)}
    parts = [part for part in conjuncts(situation) if names(part) and names(part)[0] in inputs and formula_holds(part, map, ontology)]
    return conjunction(*parts) if parts else None

"""Which services are asked for a step, and which bid is chosen (paper, "SO-MRS architecture": Arrangement)."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence

from msgspec import Struct
from msgspec.structs import replace

from somrs.entish import Formula
from somrs.entish.formula import conjunction, conjuncts, names, substitute
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.kernel.offers import Offers
from somrs.ontology.map import Map
from somrs.ontology.services import ServiceType
from somrs.ontology.truth import bindings, formula_holds
from somrs.ontology.types import Ontology
from somrs.ontology.work_budget import ExcessiveWork
from somrs.planner.model.plan import Step
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.frp import Terms
from somrs.protocol.messages.previews import Previewed
from somrs.protocol.messages.submission import Policy, Submit
from somrs.task_manager.context import Interval


class Bid(Struct, frozen=True, kw_only=True):
    """The terms of a service, with its start and finish in seconds on the coordinator's clock. `attempts`: how often it has to be asked
    until it completes the step, as far as is known."""

    participant: str
    terms: Terms
    terms_id: str
    start: float
    finish: float
    attempts: int = 1


def make_bid(participant: str, terms: Terms, terms_id: str, earliest: float, attempts: int = 1) -> Bid:
    """The bid of a participant for a step that can start at `earliest`."""
    start = max(earliest, terms.start_from or earliest)
    return Bid(participant=participant, terms=terms, terms_id=terms_id, start=start, finish=start + terms.duration, attempts=attempts)


def fit_bid(bid: Bid, busy: Iterable[Interval]) -> Bid:
    """The bid, delayed until it overlaps no interval in which the device is committed."""
    start, length = bid.start, bid.finish - bid.start
    for begins, ends in sorted(busy):
        if start < ends and start + length > begins:
            start = ends
    return replace(bid, start=start, finish=start + length)


def choose_bid(bids: Sequence[Bid], task: Submit, now: float) -> Bid:
    """The bid that the task's policy prefers, with the price and the time of all expected attempts. The participant's id decides between
    equal bids."""

    def preference(bid: Bid) -> tuple[float, float, str]:
        price, seconds = bid.attempts * bid.terms.price, bid.attempts * (bid.finish - now)
        match task.policy:
            case Policy.PRICE:
                return price, seconds, bid.participant
            case Policy.TIME:
                return seconds, price, bid.participant
            case Policy.WEIGHTED:
                return price + task.time_value * seconds, seconds, bid.participant

    return min(bids, key=preference)


def plan_preference(task: Submit, previewed: Previewed) -> tuple[float, float]:
    """What the task's policy minimises, for a plan with quotes. Plans with foreseen steps come after those that are certain, and last those
    with a step that no service takes."""
    if previewed.price is None or previewed.seconds is None:
        outlook = previewed.outlook
        if outlook is None:
            return math.inf, math.inf
        return math.inf, outlook.least_seconds if task.policy is Policy.TIME else outlook.least_price
    match task.policy:
        case Policy.PRICE:
            return previewed.price, previewed.seconds
        case Policy.TIME:
            return previewed.seconds, previewed.price
        case Policy.WEIGHTED:
            return previewed.price + task.time_value * previewed.seconds, previewed.seconds


def able_offers(step: Step, offers: Offers, types_by_name: dict[str, ServiceType], excluded: Collection[str]) -> list[Offer]:
    """The offers that can be asked for a step, without those of `excluded` services.

    They are of the step's type or a subtype. If the plan names a provider, they are of that provider or of an alternative.
    """

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
        for offer in offers.of_types(filter(is_of_type, offers.types))
        if (step.provider in (None, offer.provider) or offer.provider in step.alternative_providers) and offer.service not in excluded
    ]


def precondition_now(step: Step, service_type: ServiceType, map: Map, ontology: Ontology) -> Formula | None:
    """The step's precondition on the current map: the step's inputs stay, other variables are bound again.

    Returns None for a service type without precondition. Raises LookupError when the precondition does not hold.
    """
    if service_type.start_condition is None:
        return None
    precondition = substitute(parse(service_type.start_condition), step.bindings)
    try:
        binding = next(iter(bindings(precondition, map, ontology)), None)
    except FormulaError as error:
        raise LookupError(str(error)) from error
    if binding is None:
        raise LookupError(f"{precondition} does not hold")
    return substitute(precondition, binding)


def relevant_situation(step: Step, situation: Formula | None, map: Map, ontology: Ontology) -> Formula | None:
    """The parts of a situation that concern the step's inputs and still hold.

    A failed service reports more than the next service needs, and other tasks change the same map.
    """
    if situation is None:
        return None
    inputs = {name for term in step.inputs.values() for name in names(term)}
    parts = [part for part in conjuncts(situation) if names(part) and names(part)[0] in inputs and _still_holds(part, map, ontology)]
    return conjunction(*parts) if parts else None


def _still_holds(part: Formula, map: Map, ontology: Ontology) -> bool:
    try:
        return formula_holds(part, map, ontology)
    except ExcessiveWork:  # what a service reports is not worth more work
        return False

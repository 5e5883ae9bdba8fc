"""Plans with the conditions that services stated when they were asked for a step (`Problem.bids`).

Where a service stated a condition, every use of its service type with the same inputs becomes a service type of its own: one for each
condition, which is a further precondition, and one for the providers that stated none. The search then compares a dearer service without a
condition with a cheaper one and the steps that make its condition true. The other modules of the planner know nothing of this: the problem
is translated before the search, and its result is translated back.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from msgspec import structs

from somrs.entish import Attribute, Comparison, Formula, Name, Not, Relation, Term, Variable
from somrs.entish.formula import conjunction, disjunction, substitute, substitute_term, terms
from somrs.entish.parse import parse, parse_term
from somrs.ontology.objects import Fact, FactAdded
from somrs.ontology.services import ServiceType
from somrs.ontology.types import RelationType
from somrs.ontology.values import value_of
from somrs.planner.model.plan import NoPlan, Plan, Step, describe_use
from somrs.planner.model.problem import AvailableService, Problem, StepBid
from somrs.planner.model.world import VALUES

Inputs = tuple[tuple[str, Term], ...]

REQUESTED = "isRequested-"
"""The beginning of the name of a relation that joins the inputs with which a service type is not used otherwise than by its bids."""
MOST_VALUES = 4
"""The maximum number of requests with numbers or texts as inputs that are told apart by these; each doubles the alternatives."""

MOST_NAMED = 3
"""The maximum number of providers to name in an explanation."""


@dataclass(frozen=True, slots=True)
class _Use:
    """The use of a service type with fixed inputs and on a condition, as a service type of its own."""

    service_type: str
    inputs: Inputs
    condition: Formula | None
    services: tuple[str, ...]
    """The services that demand the condition."""
    available: AvailableService


class ConditionalUses:
    """Translates a problem with bids to one without, and the result back."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        offers = {available.service_type.name: available for available in problem.services}
        self._requests: dict[tuple[str, Inputs], list[StepBid]] = {}
        for bid in problem.bids:
            if bid.service_type in offers:
                self._requests.setdefault((bid.service_type, bid.inputs), []).append(bid)
        self._uses = {
            use.available.service_type.name: use
            for (name, inputs), bids in self._requests.items()
            for use in _uses(structs.replace(offers[name], providers=self._useful(offers[name], inputs)), inputs, bids)
        }

    def _useful(self, available: AvailableService, inputs: Inputs) -> tuple[str, ...]:
        """The providers without those that told nothing with these inputs a short time ago."""
        use = describe_use(available.service_type.name, dict(inputs))
        return tuple(provider for provider in available.providers if (provider, use) not in self._problem.fruitless)

    @property
    def problem(self) -> Problem:
        """The problem without bids. Its services are used for what they were asked only as their bids say."""
        problem = self._problem
        if not self._requests:
            return problem
        services = [use.available for use in self._uses.values()]
        relations: list[RelationType] = []
        facts: list[Fact] = []
        for available in problem.services:
            requests = [inputs for name, inputs in self._requests if name == available.service_type.name]
            if not requests:
                services.append(available)
            elif available.service_type.inputs:
                service, relation, answered = _without(available.service_type, requests)
                relations += [relation] if relation is not None else []
                facts += answered
                services.append(structs.replace(available, service_type=service))
        return structs.replace(
            problem,
            bids=(),
            ontology=problem.ontology.extended(relations),
            map=problem.map.changed(FactAdded(fact) for fact in dict.fromkeys(facts)),
            services=tuple(services),
            rest=tuple(self._rest()),
        )

    @property
    def ask_to_know(self) -> bool:
        """Whether a condition is about an attribute of which the map has no value, so that it may be a matter of knowledge."""
        problem = self._problem
        terms_of_conditions = (term for bid in problem.bids if bid.condition is not None for term in terms(bid.condition))
        return any(
            isinstance(term, Attribute)
            and isinstance(term.owner, Name)
            and term.owner.name in problem.map.objects
            and value_of(term.owner.name, term.path, problem.map, problem.ontology) is None
            for term in terms_of_conditions
        )

    def _rest(self) -> Iterator[Step]:
        """The rest of the previous plan. A step that has bids is planned anew, unless a service is committed to it."""
        for step in self._problem.rest:
            if (step.service_type, tuple(step.inputs.items())) not in self._requests:
                yield step
            elif step.id in self._problem.promised and (use := self._use_of(step)) is not None:
                yield structs.replace(step, service_type=use.available.service_type.name, inputs={})

    def _use_of(self, step: Step) -> _Use | None:
        work = step.service_type, tuple(step.inputs.items()), step.condition
        return next((use for use in self._uses.values() if (use.service_type, use.inputs, use.condition) == work), None)

    def translate(self, result: Plan | NoPlan) -> Plan | NoPlan:
        """The result with the service types and the inputs of the original problem."""
        if not self._uses:
            return result
        if isinstance(result, Plan):
            return Plan(tuple(map(self._step, result.steps)), result.links)
        reasons = tuple(reason for reason in result.reasons if REQUESTED not in reason)
        return structs.replace(result, explanation="; ".join(reasons), separate_reasons=reasons) if reasons else result

    def _step(self, step: Step) -> Step:
        use = self._uses.get(step.service_type)
        if use is None:
            return step
        return structs.replace(
            step, service_type=use.service_type, inputs=dict(use.inputs), condition=use.condition, demanded_by=use.services
        )


def _uses(available: AvailableService, inputs: Inputs, bids: Sequence[StepBid]) -> Iterator[_Use]:
    """The uses of a service type with these inputs: one for each condition, and one for the providers that stated none."""
    offered = [bid for bid in bids if not bid.refuses]
    for condition in dict.fromkeys(bid.condition for bid in offered if bid.condition is not None):
        of_condition = [bid for bid in offered if bid.condition == condition]
        yield _use(available, inputs, condition, tuple(dict.fromkeys(bid.provider for bid in of_condition)), of_condition)
    restricted = {bid.provider for bid in bids if bid.refuses or bid.condition is not None}
    others = tuple(provider for provider in available.providers if provider not in restricted)
    if others:
        yield _use(available, inputs, None, others, [bid for bid in offered if bid.condition is None])


def _use(
    available: AvailableService, inputs: Inputs, condition: Formula | None, providers: tuple[str, ...], bids: Sequence[StepBid]
) -> _Use:
    service, substitution = available.service_type, dict(inputs)
    start_condition = service.start_condition
    precondition = substitute(parse(start_condition), substitution) if start_condition is not None else None
    conditions = [part for part in (precondition, condition) if part is not None]
    prices = {provider: price for provider, price in available.prices if provider in providers}
    prices |= {bid.provider: bid.price for bid in bids if bid.price is not None}
    call = f"{service.name}({', '.join(str(term) for _, term in inputs)})"
    use = structs.replace(
        service,
        name=f"{call} by {_any_of(providers)}{f', if {condition},' if condition is not None else ''}",
        inputs=(),
        precondition=str(conjunction(*conditions)) if conditions else None,
        effect=str(substitute(parse(service.effect), substitution)),
        cost=str(substitute_term(parse_term(service.cost), substitution)) if service.cost is not None and not prices else None,
        invariant=None,
        parent=None,
        handlers=(),
    )
    services = tuple(dict.fromkeys(bid.service for bid in bids)) if condition is not None else ()
    return _Use(service.name, inputs, condition, services, AvailableService(use, providers, tuple(sorted(prices.items()))))


def _any_of(providers: Sequence[str]) -> str:
    return " or ".join(providers if len(providers) <= MOST_NAMED else [*providers[:MOST_NAMED], f"{len(providers) - MOST_NAMED} more"])


def _without(service: ServiceType, requests: Sequence[Inputs]) -> tuple[ServiceType, RelationType | None, list[Fact]]:
    """The service type restricted to other inputs than those of the requests; the relation and the facts that its precondition reads."""
    value_names = {parameter.name for parameter in service.inputs if parameter.type in VALUES}
    objects = [parameter for parameter in service.inputs if parameter.name not in value_names]
    if value_names and (len(requests) <= MOST_VALUES or not objects):
        others = [disjunction(*(Comparison(Variable(name), "!=", term) for name, term in inputs)) for inputs in requests[:MOST_VALUES]]
        return _with_precondition(service, conjunction(*others)), None, []
    relation = RelationType(name=REQUESTED + service.name, joins=tuple(parameter.type for parameter in objects))
    atom = Relation(relation.name, tuple(Variable(parameter.name) for parameter in objects))
    facts = [Fact(relation.name, tuple(str(dict(inputs)[parameter.name]) for parameter in objects)) for inputs in requests]
    return _with_precondition(service, Not(atom)), relation, facts


def _with_precondition(service: ServiceType, condition: Formula) -> ServiceType:
    parts = [parse(service.precondition)] if service.precondition is not None else []
    return structs.replace(service, precondition=str(conjunction(*parts, condition)))

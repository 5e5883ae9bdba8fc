"""The context that all transactions of a Task Manager share, and the planning problem of a task."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType

from msgspec import Struct

from somrs.entish import Formula
from somrs.entish.formula import alternatives, conjunction, names
from somrs.entish.parse import nearest
from somrs.errors import FormulaError, InputError
from somrs.kernel.component import Effects
from somrs.kernel.replica import Replica
from somrs.kernel.reservations import Reservations
from somrs.kernel.service_replica import ServiceReplica
from somrs.ontology.check import check
from somrs.ontology.services import PROVIDER, PROVIDER_TYPE, Handler
from somrs.ontology.truth import formula_holds
from somrs.ontology.types import UNKNOWN
from somrs.ontology.work_budget import ExcessiveWork, WorkBudget
from somrs.planner.model.plan import Plan
from somrs.planner.model.problem import AvailableService, Problem
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.submission import FormulaMistake, Policy, Submit, TaskRejected
from somrs.task_manager.device_queue import AtWork, DeviceQueues
from somrs.task_manager.discovery import Discovery
from somrs.task_manager.known_services import KnownServices
from somrs.task_manager.pace import Pace
from somrs.task_manager.requests import ForLook, ForPlan, Requests
from somrs.task_manager.world_clock import WorldClock

PRICE, DURATION = "Price", "Duration"
"""The attributes of a service that state a fixed price and a fixed duration."""

Interval = tuple[float, float]
"""Start and end, in seconds on the coordinator's clock."""

Commitments = Mapping[str, Sequence[Interval]]
"""The intervals in which each provider is committed."""

MOST_PRIORITY = 1000


class Quotes(Struct, kw_only=True):
    """The last price and the last duration (seconds) that each service offered."""

    prices: dict[str, float] = {}
    durations: dict[str, float] = {}

    def record_quote(self, service: str, price: float, duration: float) -> None:
        """Record the terms of a service."""
        self.prices[service], self.durations[service] = price, duration

    def last_quote(self, offer: Offer) -> tuple[float, float] | None:
        """The last price and duration of a service, or those that its attributes fix; None unless both are known."""
        price = self.prices.get(offer.service, offer.attributes.get(PRICE))
        duration = self.durations.get(offer.service, offer.attributes.get(DURATION))
        if isinstance(price, float | int) and isinstance(duration, float | int):
            return float(price), float(duration)
        return None


class PlanToQuote(Struct, frozen=True):
    """A plan for which services are to be asked for terms, to compare it with others. `id` names the quotes; `owner` is the task or preview
    that compares, and `services` is what it knows of them."""

    id: str
    owner: str
    task: Submit
    plan: Plan
    services: KnownServices


class TaskManagerContext:
    """What a transaction uses of its Task Manager. It has no state of its own, but references to that of the Task Manager."""

    def __init__(
        self,
        *,
        replica: Replica,
        requests: Requests,
        local_reservations: Reservations | None,
        discovery: Discovery,
        queues: DeviceQueues,
        quotes: Quotes,
        pace: Pace,
        clock: WorldClock,
        touched: dict[str, None],
        commitments: Callable[[], Commitments],
        still_at_work: Callable[[AtWork], bool],
        reserved_elsewhere: Callable[[str], frozenset[str]],
        may_ask: Callable[[str], bool],
    ) -> None:
        self.address = requests.address
        self.replica, self.requests, self.queues, self.quotes = replica, requests, queues, quotes
        self.local_reservations = local_reservations
        """The reservations of a Task Manager whose journal goes back to a program that had them itself, until it starts."""
        self.discovery = discovery
        self.pace, self.clock = pace, clock
        self.touched = touched
        """The transactions that changed, for the clients that watch them."""
        self.commitments = commitments
        """The intervals in which providers are committed to this Task Manager, in any transaction."""
        self.still_at_work = still_at_work
        """Whether a participant's device still carries out its last order."""
        self.reserved_elsewhere = reserved_elsewhere
        """The objects that other tasks of this Task Manager than the given one have reserved to change them."""
        self.may_ask = may_ask
        """Whether a task may ask services for terms now. Otherwise it is continued as soon as it may."""
        self.plans_to_quote: list[PlanToQuote] = []
        """The plans to quote, until the Task Manager begins with them in the same step."""

    @property
    def directory(self) -> ServiceReplica | None:
        """The copy of what the Registry lists; None: each task discovers services itself (`Discovery`)."""
        return self.discovery.directory

    def discover(self, purpose: ForPlan | ForLook, now: float, *, confirmed: bool = False) -> Effects:
        """Ask for the services on offer; `confirmed`: as they are at the Registry now."""
        if self.directory is not None:
            self.discovery.request(purpose, now, confirmed=confirmed)
        else:
            yield from self.requests.discover(purpose, now)

    def follow_arrivals(self, now: float) -> Effects:
        """Ask for news of services that join. The copy has them by itself."""
        if self.directory is None:
            yield from self.requests.follow_arrivals(now)


def planning_problem(
    task: Submit,
    replica: Replica,
    offers: Iterable[Offer],
    avoided: frozenset[str] = frozenset(),
    quotes: Mapping[str, float] = MappingProxyType({}),
) -> Problem:
    """The planning problem of a task on the current map, with these services on offer.

    The plan must not use the objects in `avoided`. `quotes` are the last prices, by service.

    Raises FormulaError when the task does not fit the map, for example because an object of the task has been removed.
    """
    providers: dict[str, list[str]] = {}
    prices: dict[str, dict[str, float]] = {}
    for offer in offers:
        providers.setdefault(offer.service_type.name, []).append(offer.provider)
        price = quotes.get(offer.service, offer.attributes.get(PRICE))
        if isinstance(price, float | int):
            prices.setdefault(offer.service_type.name, {})[offer.provider] = price
    types = {offer.service_type.name: offer.service_type for offer in offers}
    unknown = frozenset(replica.map.with_value(UNKNOWN, True)) - avoided
    return Problem(
        ontology=replica.ontology,
        map=replica.map,
        goal=check(task.effect, replica.ontology, replica.map),
        precondition=check(task.precondition, replica.ontology, replica.map) if task.precondition else None,
        excluded=avoided | unknown,
        unknown=unknown,
        services=tuple(
            AvailableService(
                service_type=types[name], providers=tuple(sorted(provider_names)), prices=tuple(sorted(prices.get(name, {}).items()))
            )
            for name, provider_names in sorted(providers.items())
        ),
        hurry=task.policy is Policy.TIME,
        recognises=task.recognise,
    )


def known_to_hold(formula: Formula, replica: Replica) -> bool:
    """Whether an alternative of the formula holds on the map, none of whose objects is marked as unknown or lost."""
    map = replica.map

    def is_known(part: Formula) -> bool:
        return not any(map.objects[name].values.get(UNKNOWN) is True for name in names(part) if name in map.objects)

    budget = WorkBudget()
    try:
        for part in (conjunction(*branch) for branch in alternatives(formula)):
            budget.spend(part)
            if is_known(part) and formula_holds(part, map, replica.ontology, budget):
                return True
        return False
    except FormulaError:
        return False


def find_task_error(task: Submit, replica: Replica) -> InputError | None:
    """The error in a task as its client stated it, or None."""
    if task.deadline is not None and not (0 < task.deadline < math.inf):
        return InputError(
            f"a deadline is a positive number of seconds from now, and not {task.deadline:g}; leave it out if there is no deadline"
        )
    if not math.isfinite(task.time_value):
        return InputError(f"time_value is the value of a second in the currency of the terms, and cannot be {task.time_value:g}")
    if abs(task.priority) > MOST_PRIORITY:
        return InputError(f"a priority is a whole number from -{MOST_PRIORITY} to {MOST_PRIORITY}, and not {task.priority}")
    try:
        problem = planning_problem(task, replica, [])
        budget = WorkBudget()
        for formula in (problem.goal, problem.precondition):
            if formula is not None:
                _check_work(formula, replica, budget)
        for handler in task.handlers:
            _check_handler(handler, replica)
    except FormulaError as error:
        return error
    return None


def _check_work(formula: Formula, replica: Replica, budget: WorkBudget) -> None:
    """Raises ExcessiveWork for a formula that is too much to evaluate on the map, as it would be again and again."""
    try:
        formula_holds(formula, replica.map, replica.ontology, budget)
    except ExcessiveWork:
        raise
    except FormulaError:
        pass  # a plan may find the values that are open


def rejection(error: InputError) -> TaskRejected:
    """The answer to a client whose task has this error."""
    mistake = None
    if isinstance(error, FormulaError):
        mistake = FormulaMistake(text=error.text, position=error.position, problem=error.problem, hint=error.hint)
    return TaskRejected(problem=str(error), mistake=mistake)


def _check_handler(handler: Handler, replica: Replica) -> None:
    """Raises FormulaError. A handler may use the inputs of its service type, if it names one, as variables."""
    service_types = replica.ontology.services
    if handler.service_type is not None and handler.service_type not in service_types:
        hint = nearest(handler.service_type, service_types) or "leave it out for a handler of all steps"
        raise FormulaError(handler.service_type, 0, f"there is no service type {handler.service_type}", hint)
    service_type = service_types.get(handler.service_type or "")
    inputs = {parameter.name: parameter.type for parameter in service_type.inputs} if service_type is not None else {}
    for formula in (handler.when, handler.effect):
        if formula is not None:
            check(formula, replica.ontology, replica.map, {**inputs, PROVIDER: PROVIDER_TYPE})

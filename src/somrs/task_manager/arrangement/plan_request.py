"""The request for a plan: discover the services on offer, then ask the planner.

The plan must avoid the objects that other tasks have reserved, and should keep the remaining steps of the previous plan. Its objects are
reserved at the Repository. If other tasks have some of them, the planner is asked again. If there is no plan without the objects of other
tasks, the planner is asked without regard to them. If it then finds a plan, the task waits for the others.
"""

from __future__ import annotations

from msgspec import Struct, field
from msgspec.structs import replace

from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.kernel.component import Ask, Effects, EffectsReturning, Withdraw
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import StepBid
from somrs.protocol.messages.reservations import ReservationMode, Reserved
from somrs.protocol.messages.submission import Submit
from somrs.task_manager.arrangement.available_services import AvailableServices
from somrs.task_manager.arrangement.plan_reservation import facts_of_several_maps, plan_reservation
from somrs.task_manager.context import TaskManagerContext, planning_problem
from somrs.task_manager.execution.workflow import Progress, Workflow
from somrs.task_manager.requests import DiscoveredOffers, ForPlan, ReservationAnswer
from somrs.task_manager.reservations import BlockedPlan, ReservationRequester
from somrs.task_manager.timers import Answer, PlanWanted


class ServicesUnknown(Struct, frozen=True):
    """The services on offer are not known, because the Registry does not answer."""

    reason: str


PlanResult = Answer | BlockedPlan | ServicesUnknown | str
"""The planner's answer; a plan that other tasks block; or the reason why the planner could not be asked."""


MOST_PLANS = 3
"""The number of plans that are compared by quotes."""


class PlanRequest(Struct, kw_only=True):
    """A request for a plan. `owner` is the task or preview, `goal` the number of its goal, `task` what the plan has to achieve.

    The plan avoids the objects in `avoided`, which other tasks change, unless the request `ignores_reservations`. `attempt` counts the
    questions to the planner. `plan`: one that was found, while its objects are being reserved.
    """

    owner: str
    goal: int
    serial: int
    task: Submit
    avoided: frozenset[str] = frozenset()
    ignores_reservations: bool = field(default=False, name="regardless")
    attempt: int = 0
    plan: Plan | None = None
    bids: tuple[StepBid, ...] = ()
    """What services answered when they were asked for steps of earlier plans, if a condition was stated."""
    most_plans: int = 1
    offers_version: int = -1
    """That of the services on offer with which the planner was asked."""
    rejected: NoPlan | None = None
    """The planner found no plan, and the Registry is asked whether news of services is on its way."""
    is_confirmed: bool = False

    @property
    def purpose(self) -> ForPlan:
        return ForPlan(self.owner, self.goal, self.serial)

    @property
    def question(self) -> PlanWanted:
        return PlanWanted(self.owner, self.goal, self.serial, self.attempt)


class PlanRequester:
    """Carries out a request. `old_workflow`: the plan that the new one replaces. `modes`: how the objects of a plan are reserved, and those
    of a plan that needs objects of others."""

    def __init__(
        self,
        request: PlanRequest,
        services: AvailableServices,
        context: TaskManagerContext,
        reserving: ReservationRequester,
        modes: tuple[ReservationMode, ReservationMode],
        old_workflow: Workflow | None = None,
    ) -> None:
        self._request, self._services, self._context, self._reserving = request, services, context, reserving
        self._modes, self._old_workflow = modes, old_workflow

    def begin(self, now: float) -> Effects:
        yield from self._context.discover(self._request.purpose, now)

    def discovered(self, offers: DiscoveredOffers) -> EffectsReturning[PlanResult | None]:
        """Handle the services on offer, or the reason why they are not known. Returns None if the planner is asked."""
        if isinstance(offers, str):
            return ServicesUnknown(offers)
        rejected, self._request.rejected = self._request.rejected, None
        if rejected is not None and self._request.offers_version == self._offers_version:
            return rejected
        self._services.discovered(offers)
        self._request.avoided = self._context.reserved_elsewhere(self._request.owner)
        return (yield from self._ask())

    @property
    def _offers_version(self) -> int:
        directory = self._context.directory
        return directory.version if directory is not None else -1

    def _ask(self) -> EffectsReturning[PlanResult | None]:
        request, context = self._request, self._context
        avoided = request.avoided if not request.ignores_reservations else frozenset()
        try:
            task = planning_problem(request.task, context.replica, self._services.usable, avoided, context.quotes.prices)
        except FormulaError as error:
            return f"the task does not fit the map any more: {error}"
        services = self._services
        task = replace(
            task,
            lost=tuple(services.excluded_services),
            rejected=tuple(services.rejected_services),
            resting=tuple(services.resting_services),
            fruitless=services.fruitless,
            observed=services.told,
            most_plans=request.most_plans,
        )
        if self._old_workflow is not None:
            remaining_runs = self._old_workflow.remaining
            promised = frozenset(run.step.id for run in remaining_runs if run.progress is Progress.ARRANGED)
            task = replace(task, rest=tuple(run.step for run in remaining_runs), promised=promised)
        bids = tuple(bid for bid in request.bids if bid.service not in self._services.broken)
        task = replace(task, bids=bids if any(bid.condition is not None for bid in bids) else ())
        request.attempt += 1
        request.offers_version = self._offers_version
        yield Ask(request.question, task)
        return None

    def answered(self, value: Answer, now: float) -> EffectsReturning[PlanResult | None]:
        """Handle the planner's answer. Returns None if the planner is asked again, or the objects of the plan are being reserved."""
        request = self._request
        if isinstance(value, NoPlan) and request.avoided and not request.ignores_reservations:
            request.ignores_reservations = True
            return (yield from self._ask())
        if isinstance(value, NoPlan) and not request.is_confirmed and self._context.directory is not None:
            request.rejected, request.is_confirmed = value, True
            yield from self._context.discover(request.purpose, now, confirmed=True)
            return None
        if isinstance(value, Plan):
            return (yield from self._plan_found(value, now))
        return value

    def _plan_found(self, plan: Plan, now: float) -> EffectsReturning[PlanResult | None]:
        request = self._request
        if request.task.recognise:
            return plan  # who looks at an object does not hinder others
        request.plan = plan
        return (yield from self._reserve(plan, now))

    def _reserve(self, plan: Plan, now: float) -> EffectsReturning[PlanResult | None]:
        request, replica = self._request, self._context.replica
        needed = plan_reservation(plan.steps, parse(request.task.effect), replica.ontology).within(replica.map.objects)
        mode = self._modes[request.ignores_reservations]
        facts = facts_of_several_maps(plan.steps, needed.changes, replica.map, replica.ontology)
        answer = yield from self._reserving.request(needed, mode, request.goal, now, facts)
        return (yield from self.reserved(answer, now)) if answer is not None else None

    def reserved(self, answer: ReservationAnswer, now: float) -> EffectsReturning[PlanResult | None]:
        """Handle the Repository's answer to the request for the plan's objects. Returns None if the planner or the Repository is asked
        again."""
        request = self._request
        plan, request.plan = request.plan, None
        if plan is None or isinstance(answer, str):
            return answer if isinstance(answer, str) else None
        if isinstance(answer, Reserved):
            return plan
        contested_objects = frozenset(name for holder in answer.holders for name in holder.objects)
        if request.ignores_reservations and self._modes[True] is ReservationMode.WAIT and not answer.waits:
            request.plan = plan  # what was granted is lost again
            return (yield from self._reserve(plan, now))
        if request.ignores_reservations:
            return BlockedPlan(holders=answer.holders, plan=plan)
        if contested_objects <= request.avoided:
            request.ignores_reservations, request.plan = True, plan
            return (yield from self._reserve(plan, now))
        request.avoided |= contested_objects
        return (yield from self._ask())

    def withdraw(self) -> Effects:
        """Withdraw the question to the planner: its plan is out of date, or not needed."""
        if self._request.attempt and self._request.plan is None and self._request.rejected is None:
            yield Withdraw(self._request.question)

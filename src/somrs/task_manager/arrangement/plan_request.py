"""The request for a plan: discover the services on offer, then ask the planner.

The plan must avoid the objects that other tasks have reserved, and should keep the remaining steps of the previous plan. If there is no
such plan, the planner is asked again without regard to reservations. If it then finds a plan, the task waits for the other tasks.
"""

from __future__ import annotations

from msgspec import Struct, field
from msgspec.structs import replace

from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.kernel.component import Ask, Effects, EffectsReturning, Withdraw
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import StepBid
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.submission import Submit
from somrs.task_manager.arrangement.available_services import AvailableServices
from somrs.task_manager.context import TaskManagerContext, planning_problem
from somrs.task_manager.execution.workflow import Progress, Workflow
from somrs.task_manager.requests import ForPlan
from somrs.task_manager.reservations import BlockedPlan, plan_reservation
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
    questions to the planner.
    """

    owner: str
    goal: int
    serial: int
    task: Submit
    avoided: frozenset[str] = frozenset()
    ignores_reservations: bool = field(default=False, name="regardless")
    attempt: int = 0
    bids: tuple[StepBid, ...] = ()
    """What services answered when they were asked for steps of earlier plans, if a condition was stated."""
    most_plans: int = 1

    @property
    def purpose(self) -> ForPlan:
        return ForPlan(self.owner, self.goal, self.serial)

    @property
    def question(self) -> PlanWanted:
        return PlanWanted(self.owner, self.goal, self.serial, self.attempt)


class PlanRequester:
    """Carries out a request. `old_workflow`: the plan that the new one replaces. `reserves`: the task reserves what the plan needs."""

    def __init__(
        self,
        request: PlanRequest,
        services: AvailableServices,
        context: TaskManagerContext,
        old_workflow: Workflow | None = None,
        *,
        reserves: bool = True,
    ) -> None:
        self._request, self._services, self._context, self._old_workflow, self._reserves = (
            request,
            services,
            context,
            old_workflow,
            reserves,
        )

    def begin(self, now: float) -> Effects:
        yield from self._context.requests.discover(self._request.purpose, now)

    def discovered(self, offers: tuple[Offer, ...] | str) -> EffectsReturning[PlanResult | None]:
        """Handle the services on offer, or the reason why they are not known. Returns None if the planner is asked."""
        if isinstance(offers, str):
            return ServicesUnknown(offers)
        self._services.discovered(offers)
        self._request.avoided = self._context.reservations.reserved_objects(self._request.owner)
        return (yield from self._ask())

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
        yield Ask(request.question, task)
        return None

    def answered(self, value: Answer) -> EffectsReturning[PlanResult | None]:
        """Handle the planner's answer. Returns None if the planner is asked again."""
        request = self._request
        if isinstance(value, NoPlan) and request.avoided and not request.ignores_reservations:
            request.ignores_reservations = True
            return (yield from self._ask())
        if isinstance(value, Plan):
            return (yield from self._plan_found(value))
        return value

    def _plan_found(self, plan: Plan) -> EffectsReturning[PlanResult | None]:
        request, reservations = self._request, self._context.reservations
        if request.task.recognise:
            return plan  # who looks at an object does not hinder others
        replica = self._context.replica
        reservation = plan_reservation(plan.steps, parse(request.task.effect), replica.ontology).within(replica.map.objects)
        conflicts = reservations.conflicts(request.owner, reservation)
        if not conflicts:
            if self._reserves:
                reservations.hold(request.owner, reservation)
            return plan
        contested_objects = frozenset[str]().union(*conflicts.values())
        if request.ignores_reservations or contested_objects <= request.avoided:
            return BlockedPlan(reservation=reservation, holders=reservations.describe(conflicts), plan=plan)
        request.avoided |= contested_objects  # other tasks rely on these objects, or have reserved them meanwhile
        return (yield from self._ask())

    def withdraw(self) -> Effects:
        """Withdraw the question to the planner: its plan is out of date, or not needed."""
        if self._request.attempt:
            yield Withdraw(self._request.question)

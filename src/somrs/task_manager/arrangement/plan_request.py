"""A plan that is being made: first the services on offer are discovered, then the planner is asked, for one that leaves alone what
other tasks have, and keeps what still stands of the plan before. When there is none, it is found out whether there would be one
without them: then they have to be waited for.
"""

from __future__ import annotations

from msgspec import Struct, field
from msgspec.structs import replace

from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.kernel.component import Ask, Effects, EffectsReturning, Withdraw
from somrs.planner.model.plan import NoPlan, Plan
from somrs.protocol.messages.clients import Submit
from somrs.protocol.messages.directory import Offer
from somrs.task_manager.arrangement.available_services import AvailableServices
from somrs.task_manager.context import TaskManagerContext, planning_problem
from somrs.task_manager.execution.workflow import Progress, Workflow
from somrs.task_manager.requests import ForPlan
from somrs.task_manager.reservations import BlockedPlan, plan_reservation
from somrs.task_manager.timers import Answer, PlanWanted

PlanResult = Answer | BlockedPlan | str
"""What the planner answered; who has what is needed; or a text that says why it could not be asked."""


class PlanRequest(Struct, kw_only=True):
    """For the goal of that number of a task, or preview; `task` is what is wanted. `avoided` are objects that other
    tasks have reserved; a plan that `ignores_reservations` may need them. `attempt`: how often the planner was asked."""

    owner: str
    goal: int
    serial: int
    task: Submit
    avoided: frozenset[str] = frozenset()
    ignores_reservations: bool = field(default=False, name="regardless")
    attempt: int = 0

    @property
    def purpose(self) -> ForPlan:
        return ForPlan(self.owner, self.goal, self.serial)

    @property
    def question(self) -> PlanWanted:
        return PlanWanted(self.owner, self.goal, self.serial, self.attempt)


class PlanRequester:
    """Brings a request to its end. `before` is the plan that it replaces; `holds`: what the plan needs is the task's from then on."""

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
        """The services on offer are known, or why they cannot be. What came of it, unless the planner was asked."""
        if isinstance(offers, str):
            return offers
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
        task = replace(task, lost=tuple(self._services.excluded_services))
        if self._old_workflow is not None:
            remaining_runs = self._old_workflow.remaining
            promised = frozenset(run.step.id for run in remaining_runs if run.progress is Progress.ARRANGED)
            task = replace(task, rest=tuple(run.step for run in remaining_runs), promised=promised)
        request.attempt += 1
        yield Ask(request.question, task)
        return None

    def answered(self, value: Answer) -> EffectsReturning[PlanResult | None]:
        """The planner answered. What came of it, unless it was asked once more."""
        request = self._request
        if isinstance(value, NoPlan) and request.avoided and not request.ignores_reservations:
            request.ignores_reservations = True
            return (yield from self._ask())
        if isinstance(value, Plan):
            return (yield from self._plan_found(value))
        return value

    def _plan_found(self, plan: Plan) -> EffectsReturning[PlanResult | None]:
        request, reservations = self._request, self._context.reservations
        reservation = plan_reservation(plan.steps, parse(request.task.effect), self._context.replica.ontology)
        conflicts = reservations.conflicts(request.owner, reservation)
        if not conflicts:
            if self._reserves:
                reservations.hold(request.owner, reservation)
            return plan
        contested_objects = frozenset[str]().union(*conflicts.values())
        if request.ignores_reservations or contested_objects <= request.avoided:
            return BlockedPlan(reservation=reservation, holders=conflicts, plan=plan)
        request.avoided |= contested_objects  # it changes what others rely on, or they have taken it meanwhile
        return (yield from self._ask())

    def withdraw(self) -> Effects:
        """It is out of date, or not wanted any more."""
        if self._request.attempt:
            yield Withdraw(self._request.question)

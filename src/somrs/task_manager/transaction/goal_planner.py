"""The planning of one goal: its requests for a plan, and the comparison of several plans for it.

What follows from a plan, or from the lack of one, is decided in `goal_executor.py`.
"""

from __future__ import annotations

from msgspec import structs

from somrs.kernel.component import Effects, EffectsReturning
from somrs.planner.model.plan import Plan
from somrs.protocol.messages import events
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.previews import Previewed
from somrs.protocol.messages.reservations import ReservationMode
from somrs.protocol.messages.task_views import Phase
from somrs.task_manager.arrangement.plan_request import MOST_PLANS, PlanRequest, PlanRequester, PlanResult
from somrs.task_manager.requests import DiscoveredOffers, ReservationAnswer
from somrs.task_manager.timers import Answer, PlanWanted
from somrs.task_manager.transaction.plan_comparison import PlanComparison
from somrs.task_manager.transaction.scope import TaskScope
from somrs.task_manager.transaction.state import GoalExecution


class GoalPlanner:
    """Requests the plans of one goal. It has no state of its own."""

    def __init__(self, execution: GoalExecution, scope: TaskScope) -> None:
        self._execution, self._scope = execution, scope

    def request(self, now: float) -> Effects:
        """Request a plan from the present situation."""
        execution, state = self._execution, self._scope.state
        execution.phase = Phase.PLANNING
        # The client's precondition concerns only the initial situation.
        precondition = state.task.precondition if execution.kind is GoalKind.TASK and execution.plans == 0 else None
        task = structs.replace(state.task, effect=execution.goal, precondition=precondition)
        conditions = execution.conditions
        if stated := conditions.begin_plan():
            self._scope.log_event(events.ConditionsAdopted(conditions=stated), now)
        execution.request = PlanRequest(
            owner=state.id,
            goal=execution.number,
            serial=execution.plans,
            task=task,
            bids=tuple(conditions.bids),
            # Later, devices wait for the new plan.
            most_plans=MOST_PLANS if execution.kind is GoalKind.TASK and execution.plans == 0 else 1,
        )
        execution.plans += 1
        execution.deferred_plan = None
        yield from self._requester(execution.request).begin(now)

    def _requester(self, request: PlanRequest) -> PlanRequester:
        scope, waits = self._scope, self._execution.kind is GoalKind.TASK
        modes = ReservationMode.TRY, ReservationMode.WAIT if waits else ReservationMode.TRY
        return PlanRequester(request, scope.services, scope.context, scope.reserving, modes, self._execution.workflow)

    def discovered(self, serial: int, offers: DiscoveredOffers) -> EffectsReturning[PlanResult | None]:
        """Handle the services on offer; they are ignored if the request is out of date. Returns its result, if it has one."""
        request = self._execution.request
        if request is None or request.serial != serial:
            return None
        return self._concluded((yield from self._requester(request).discovered(offers)))

    def answered(self, question: PlanWanted, answer: Answer, now: float) -> EffectsReturning[PlanResult | None]:
        """Handle the planner's answer; it is ignored if the question is out of date. Returns the result of the request, if it has one."""
        request = self._execution.request
        if request is None or request.question != question:
            return None
        return self._concluded((yield from self._requester(request).answered(answer, now)))

    def reserved(self, answer: ReservationAnswer, now: float) -> EffectsReturning[PlanResult | None]:
        """Handle the answer to the request for the objects of a plan. Returns the result of the request for the plan, if it has one."""
        request = self._execution.request
        if request is not None and request.plan is not None:
            return self._concluded((yield from self._requester(request).reserved(answer, now)))
        return self._comparison.reserved(answer, now)

    def _concluded(self, result: PlanResult | None) -> PlanResult | None:
        """The result of a request; None also if there are several plans, which are compared first."""
        if result is not None:
            self._execution.request = None
        if isinstance(result, Plan) and result.alternatives:
            self._comparison.begin((result, *result.alternatives))
            return None
        return result

    def plan_quoted(self, id: str, previewed: Previewed, now: float) -> EffectsReturning[Plan | None]:
        """Handle the quotes for one of several plans. Returns the plan that the policy prefers, when all have come and its objects are
        reserved."""
        return (yield from self._comparison.plan_quoted(id, previewed, now))

    @property
    def _comparison(self) -> PlanComparison:
        return PlanComparison(self._execution, self._scope)

    @property
    def is_active(self) -> bool:
        """Whether a plan is being made, or plans are being compared."""
        return self._execution.request is not None or self._execution.comparison is not None

    def withdraw(self) -> Effects:
        """Withdraw the question to the planner, or the comparison of its plans."""
        execution = self._execution
        if execution.request is not None:
            yield from self._requester(execution.request).withdraw()
        execution.request = execution.comparison = None

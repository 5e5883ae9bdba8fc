"""The comparison of several plans for a goal, by the terms that services quote for their steps (paper: "Planner returns abstract plans").

Each plan is quoted like a preview (`preview.py`); no terms are accepted. Then the policy of the task prefers one plan, which is arranged.
"""

from __future__ import annotations

from collections.abc import Sequence

from somrs.entish.parse import parse
from somrs.kernel.component import EffectsReturning
from somrs.planner.model.plan import Plan
from somrs.protocol.messages import events
from somrs.protocol.messages.previews import Previewed
from somrs.protocol.messages.reservations import ReservationMode, Reserved
from somrs.task_manager.arrangement.plan_reservation import facts_of_several_maps, plan_reservation
from somrs.task_manager.context import PlanToQuote
from somrs.task_manager.execution.bids import plan_preference
from somrs.task_manager.requests import ReservationAnswer
from somrs.task_manager.transaction.scope import TaskScope
from somrs.task_manager.transaction.state import Comparison, GoalExecution


class PlanComparison:
    """Compares the plans of one goal. It has no state of its own."""

    def __init__(self, execution: GoalExecution, scope: TaskScope) -> None:
        self._execution, self._scope = execution, scope

    def begin(self, plans: Sequence[Plan]) -> None:
        """Have services quote the plans."""
        execution, state = self._execution, self._scope.state
        ids = [f"{state.id}/{execution.plans}.{number}" for number in range(1, len(plans) + 1)]
        execution.comparison = Comparison(plans=dict(zip(ids, plans, strict=True)))
        for id, plan in execution.comparison.plans.items():
            self._scope.context.plans_to_quote.append(PlanToQuote(id, state.id, state.task, plan, self._scope.services.for_quotes()))

    def plan_quoted(self, id: str, previewed: Previewed, now: float) -> EffectsReturning[Plan | None]:
        """Handle the quotes for one of the plans. Returns the preferred plan when all have come, and its objects are reserved."""
        comparison = self._execution.comparison
        if comparison is None or id not in comparison.plans:
            return None
        comparison.previews[id] = previewed
        if len(comparison.previews) < len(comparison.plans):
            return None
        task, replica = self._scope.state.task, self._scope.context.replica
        comparison.chosen = min(comparison.plans, key=lambda id: plan_preference(task, comparison.previews[id]))
        chosen = comparison.plans[comparison.chosen]
        needed = plan_reservation(chosen.steps, parse(self._execution.goal), replica.ontology).within(replica.map.objects)
        facts = facts_of_several_maps(chosen.steps, needed.changes, replica.map, replica.ontology)
        answer = yield from self._scope.reserving.request(needed, ReservationMode.TRY, self._execution.number, now, facts)
        return self.reserved(answer, now) if answer is not None else None

    def reserved(self, answer: ReservationAnswer, now: float) -> Plan | None:
        """Handle the answer to the request for the objects of the preferred plan. Those of the first are reserved already."""
        comparison = self._execution.comparison
        if comparison is None or comparison.chosen is None:
            return None
        self._execution.comparison = None
        best = comparison.chosen if isinstance(answer, Reserved) else next(iter(comparison.plans))
        plans = tuple(compared_plan(plan, comparison.previews[id]) for id, plan in comparison.plans.items())
        self._scope.log_event(events.PlansCompared(plans=plans, chosen=[*comparison.plans].index(best)), now, None)
        return comparison.plans[best]


def compared_plan(plan: Plan, previewed: Previewed) -> events.ComparedPlan:
    types = tuple(step.service_type for step in plan.topological())
    return events.ComparedPlan(service_types=types, price=previewed.price, currency=previewed.currency, seconds=previewed.seconds)

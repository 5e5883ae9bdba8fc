"""After a failure: what it costs to go on from there, and what it costs to undo first what the failure left.

To go on is the rule. To undo first is an option only if the services that failed have stated a penalty for undoing in their terms. The
costs are estimates, from the last terms of services.
"""

from __future__ import annotations

from collections.abc import Iterable

from somrs.planner.model.plan import Plan, Step
from somrs.protocol.messages.events import UndoingCheaper
from somrs.protocol.messages.submission import Policy, Submit
from somrs.task_manager.transaction.scope import TaskScope
from somrs.task_manager.transaction.state import GoalExecution

Amount = tuple[float, float]
"""A price, and a duration in seconds."""


def undoing_is_cheaper(execution: GoalExecution, scope: TaskScope, plan: Plan) -> UndoingCheaper | None:
    """The two costs, if to undo first and then to do the rest of the old plan costs less than the plan from the present situation."""
    state = scope.state
    works = state.log.interrupted()
    if execution is not state.goal or state.ending is not None or execution.workflow is None or not works:
        return None
    amounts: list[Amount] = []
    for work in works:
        member = state.members.find_member(work.participant)
        terms = member.session.terms if member is not None else None
        if terms is None or terms.penalty is None:
            return None
        amounts.append((terms.penalty, terms.duration))
    rest = _amounts((run.step for run in execution.workflow.remaining), scope)
    new = _amounts(plan.steps, scope)
    if rest is None or new is None:
        return None
    undoing, going_on = _cost(state.task, [*amounts, *rest]), _cost(state.task, new)
    return UndoingCheaper(undoing=undoing, going_on=going_on) if undoing < going_on else None


def _amounts(steps: Iterable[Step], scope: TaskScope) -> list[Amount] | None:
    """The best last terms for each step; None if there are none for one of them."""
    amounts: list[Amount] = []
    for step in steps:
        quotes = [quote for offer in scope.services.offers_for(step) if (quote := scope.context.quotes.last_quote(offer)) is not None]
        if not quotes:
            return None
        amounts.append(min(quotes, key=lambda quote: _cost(scope.state.task, [quote])))
    return amounts


def _cost(task: Submit, amounts: Iterable[Amount]) -> float:
    """What the policy of the task minimises. The durations are added up, as if one step followed the other."""
    price, duration = (sum(column) for column in zip(*amounts, strict=True)) if (amounts := [*amounts]) else (0.0, 0.0)
    match task.policy:
        case Policy.PRICE:
            return price
        case Policy.TIME:
            return duration
        case Policy.WEIGHTED:
            return price + task.time_value * duration

"""What a plan with foreseen steps costs, as far as it can be said before their services are asked.

A foreseen step depends on what an earlier step finds out: no service can quote it yet. It costs and takes what the services that can do it
asked last, or state in their offers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from somrs.planner.model.plan import Plan, Step
from somrs.protocol.messages.previews import Outlook

LastTerms = Callable[[Step], Sequence[tuple[float, float]]]
"""The last prices and durations (s) of the services that can do a step."""


def foresee(plan: Plan, price: float, seconds: float, last_terms: LastTerms) -> Outlook | None:
    """The outlook of a plan whose certain part has this price and takes so long; None if no step is foreseen."""
    certain = {step.id for step in plan.certain_part.steps}
    foreseen = [step for step in plan.topological() if step.id not in certain]
    if not foreseen:
        return None
    terms = {step.id: last_terms(step) for step in foreseen}
    finish: dict[str, float] = {}
    for step in foreseen:
        start = max((finish.get(id, seconds) for id in plan.predecessors(step.id)), default=seconds)
        finish[step.id] = start + min((duration for _, duration in terms[step.id]), default=0.0)
    prices = [[price for price, _ in terms[step.id]] for step in foreseen if terms[step.id]]
    unknown = tuple(step.id for step in foreseen if not terms[step.id])
    return Outlook(
        least_price=price + sum(map(min, prices)),
        most_price=price + sum(map(max, prices)) if not unknown else None,
        least_seconds=max(finish.values()),
        unknown=unknown,
    )

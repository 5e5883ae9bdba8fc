"""What a task has cost so far, and when it will probably end: computed from its view, for the windows and the terminal."""

from __future__ import annotations

from collections.abc import Iterable

from msgspec import Struct

from somrs.client.durations import format_duration
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.task_views import Phase, StepView, TaskView, WorkView


class Cost(Struct, frozen=True, kw_only=True):
    """Sums of prices, by currency.

    `completed`: of the work that services have completed, undone later or not. `contracted`: of the work under way, and of the steps for
    which a contract has been made. Services that failed or were released have no price.
    """

    completed: dict[str, float]
    contracted: dict[str, float]


def cost(view: TaskView) -> Cost | None:
    """What the task has cost so far; None for records of earlier versions, which do not have the prices of its work."""
    completed = [work for work in view.work if work.result is State.COMPLETED]
    if any(work.price is None for work in completed):
        return None
    under_way = [work for work in view.work if work.result is None]
    steps = [step for step in view.steps if step.state is State.COMMITTED]
    return Cost(completed=_sums(completed), contracted=_sums([*under_way, *steps]) if view.outcome is None else {})


def cost_text(view: TaskView) -> str:
    """The cost as text; empty if it is not known."""
    amounts = cost(view)
    if amounts is None:
        return ""
    completed = _amounts_text(amounts.completed) or "nothing"
    if view.outcome is not None:
        return completed
    contracted = _amounts_text(amounts.contracted)
    return f"{completed} so far" + (f", {contracted} contracted" if contracted else "")


def remaining_time(view: TaskView, now: float) -> float | None:
    """The seconds until the last step will be completed; None while it is not known.

    A step takes as long as its terms say. A step under way takes the rest of that time: according to its progress or, until progress is
    reported, to its start. A step begins after the steps that it needs and after the earlier steps of the plan that the same device does.
    """
    if view.phase is not Phase.EXECUTING:
        return None
    started_at = {work.step: work.began for work in view.work}
    finish: dict[str, float] = {}
    free: dict[str, float] = {}
    """When each device has done the steps so far."""
    for step in view.steps:
        if step.state is State.COMPLETED:
            finish[step.step] = 0.0
            continue
        if step.duration is None or step.service is None:
            return None
        device = step.service.partition(".")[0]
        if step.state is State.EXECUTING:
            elapsed = step.fraction * step.duration or now - started_at.get(step.step, now)
            finish[step.step] = max(0.0, step.duration - elapsed)
        else:
            finish[step.step] = max([free.get(device, 0.0), *(finish.get(before, 0.0) for before in step.after)]) + step.duration
        free[device] = max(free.get(device, 0.0), finish[step.step])
    return max(finish.values(), default=0.0)


def remaining_text(view: TaskView, now: float) -> str:
    """The remaining time as text; empty after the end."""
    if view.outcome is not None:
        return ""
    seconds = remaining_time(view, now)
    if seconds is None:
        return "not known yet"
    return f"about {format_duration(seconds)}" if seconds > 0 else "due now"


def _sums(priced: Iterable[WorkView | StepView]) -> dict[str, float]:
    sums: dict[str, float] = {}
    for part in priced:
        if part.price is not None:
            sums[part.currency] = sums.get(part.currency, 0.0) + part.price
    return sums


def _amounts_text(amounts: dict[str, float]) -> str:
    return " + ".join(f"{amount:g} {currency}" for currency, amount in sorted(amounts.items()))

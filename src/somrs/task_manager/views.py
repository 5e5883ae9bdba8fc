"""Tasks, steps and plans as clients see them (the values of `protocol/clients.py`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from somrs.errors import FormulaError
from somrs.planner.plan import NoPlan, Plan, Step
from somrs.protocol.clients import Previewed, StepView, TaskView
from somrs.protocol.frp import State
from somrs.task_manager.workflow import Progress, StepRun

if TYPE_CHECKING:
    from somrs.task_manager.transaction import Transaction

STEP_STATE = {
    Progress.OPEN: State.NEW,
    Progress.ARRANGING: State.ARRANGING,
    Progress.ARRANGED: State.COMMITTED,
    Progress.EXECUTING: State.EXECUTING,
    Progress.REPORTING: State.EXECUTING,
    Progress.DONE: State.COMPLETED,
}
"""How a step looks to clients who know the protocol's states only."""


def view(transaction: Transaction) -> TaskView:
    """A transaction as clients see it."""
    workflow = transaction.wish.workflow
    return TaskView(
        task=transaction.id,
        effect=transaction.task.effect,
        phase=transaction.phase,
        submitted_at=transaction.submitted_at,
        outcome=transaction.outcome,
        ended_at=transaction.ended_at,
        explanation=transaction.explanation or transaction.wish.waits,
        steps=tuple(_run_view(workflow.plan, run) for run in workflow) if workflow is not None else (),
        work=tuple(work.view() for work in transaction.ledger),
        client=transaction.client,
        precondition=transaction.task.precondition,
        policy=transaction.task.policy,
        time_value=transaction.task.time_value,
        deadline=transaction.task.deadline,
        handlers=transaction.task.handlers,
        priority=transaction.task.priority,
    )


def _run_view(plan: Plan, run: StepRun) -> StepView:
    member = run.member
    return step_view(
        run.step,
        plan,
        state=STEP_STATE[run.progress],
        service=member.offer.service if member else None,
        price=member.bid.terms.price if member and member.bid else None,
        duration=member.bid.terms.duration if member and member.bid else None,
        fraction=member.fraction if member else 0.0,
    )


def step_view(
    step: Step,
    plan: Plan,
    *,
    state: State = State.NEW,
    service: str | None = None,
    price: float | None = None,
    duration: float | None = None,
    fraction: float = 0.0,
) -> StepView:
    """A step of a plan as clients see it."""
    links = plan.links_to(step.id)
    return StepView(
        step=step.id,
        service_type=step.service_type,
        inputs={name: str(term) for name, term in step.inputs.items()},
        after=tuple(dict.fromkeys(link.before for link in links)),
        because=tuple(link.fact for link in links),
        state=state,
        service=service,
        price=price,
        duration=duration,
        fraction=fraction,
    )


def previewed(found: object) -> Previewed:
    """What the planner found, for a client that wanted to see only."""
    match found:
        case Plan():
            steps = tuple(step_view(step, found) for step in found.topological())
            return Previewed(steps=steps, explanation="" if found.steps else "nothing to do: it is so already")
        case NoPlan():
            return Previewed(steps=(), explanation=found.explanation)
        case FormulaError():
            return Previewed(steps=(), explanation=str(found))
        case str(why):
            return Previewed(steps=(), explanation=why)
        case _:
            return Previewed(steps=(), explanation=f"planning failed: {found}")

"""The state of a preview, from the request of a client or from a plan that is compared with others. `preview.py` continues it."""

from __future__ import annotations

from msgspec import Struct, field

from somrs.planner.model.plan import Plan
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.event_text import waiting_text
from somrs.protocol.messages.previews import Preview, Previewed, Quotation
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.waits import WaitsForTasks
from somrs.task_manager.arrangement.call_for_proposals import OpenCalls
from somrs.task_manager.arrangement.conditions import StatedConditions
from somrs.task_manager.arrangement.plan_request import MOST_PLANS, PlanRequest
from somrs.task_manager.context import PlanToQuote
from somrs.task_manager.execution.member import Members
from somrs.task_manager.execution.workflow import Workflow
from somrs.task_manager.known_services import KnownServices
from somrs.task_manager.reservations import TaskReservation
from somrs.task_manager.timers import BidsDue


class PreviewState(Struct, kw_only=True):
    """The state of one preview. Its result answers `request`, once; or it goes to the `owner`, a task or preview that compares plans."""

    id: str
    query: Preview = field(name="wanted")
    request: Message | None
    task: Submit
    planning: PlanRequest
    calls: OpenCalls
    services: KnownServices = field(default_factory=KnownServices)
    members: Members = field(default_factory=Members)
    workflow: Workflow = field(default_factory=lambda: Workflow.from_plan(Plan()))
    outlook: Plan | None = None
    """The whole plan, with steps that depend on what others find out; services are asked only for the others."""
    bidding_start: float = field(default=0.0, name="asked_at")
    reservation: TaskReservation = field(default_factory=TaskReservation)
    """The question whether the objects are free: a preview reserves nothing."""
    waiting_for: WaitsForTasks | None = None
    quotations: dict[str, list[Quotation]] = {}
    """By step."""
    unserved: dict[str, str] = {}
    conditions: StatedConditions = field(default_factory=StatedConditions)
    ended: bool = field(default=False, name="over")
    owner: str | None = None
    rivals: dict[str, Previewed | None] = {}
    """The previews of the other plans for the task, by id; None until they have ended."""
    result: Previewed | None = None
    """The result, while it waits for the rivals."""

    @property
    def waits(self) -> str:
        return waiting_text(self.waiting_for) if self.waiting_for is not None else ""


def new_preview(id: str, query: Preview, request: Message) -> PreviewState:
    """A preview that a client has just requested; `begin` it next."""
    task = Submit(
        effect=query.effect,
        precondition=query.precondition,
        policy=query.policy,
        time_value=query.time_value,
        deadline=query.deadline,
        priority=query.priority,
        recognise=query.recognise,
    )
    planning = PlanRequest(owner=id, goal=0, serial=0, task=task, most_plans=MOST_PLANS if query.quotes else 1)
    return PreviewState(id=id, query=query, request=request, task=task, planning=planning, calls=OpenCalls(timer=BidsDue(id, 0)))


def preview_of_plan(quoted: PlanToQuote) -> PreviewState:
    """A preview of a given plan, for the task or preview that compares it with others; `begin_with_plan` next."""
    task = quoted.task
    query = Preview(effect=task.effect, quotes=True, policy=task.policy, time_value=task.time_value, deadline=task.deadline)
    return PreviewState(
        id=quoted.id,
        query=query,
        request=None,
        task=task,
        planning=PlanRequest(owner=quoted.id, goal=0, serial=0, task=task),
        calls=OpenCalls(timer=BidsDue(quoted.id, 0)),
        services=quoted.services,
        owner=quoted.owner,
    )

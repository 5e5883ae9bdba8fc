"""One task as data: all that a Task Manager knows of it."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct, field

from somrs.protocol.messages.clients import Phase, Submit
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.events import Event, EventKind, GoalKind, WaitsForTasks, kind_of
from somrs.protocol.messages.frp import Outcome
from somrs.task_manager.arrangement.available_services import KnownServices
from somrs.task_manager.arrangement.call_for_proposals import OpenCalls
from somrs.task_manager.arrangement.plan_request import PlanRequest
from somrs.task_manager.execution.execution_log import ExecutionLog
from somrs.task_manager.execution.participants import Members
from somrs.task_manager.execution.reports import Reports
from somrs.task_manager.execution.workflow import StepRun, Workflow
from somrs.task_manager.recovery.compensation import Undoing
from somrs.task_manager.recovery.ladder import Replans
from somrs.task_manager.recovery.observation import Look, LookQueue
from somrs.task_manager.timers import BidsDue


class GoalExecution(Struct, kw_only=True, eq=False):
    """One formula that is being made true. `goal` is Entish. `work` is the number of what it is about, when it is not the task's own goal;
    `look` what is to be found out."""

    number: int
    goal: str
    kind: GoalKind
    calls: OpenCalls
    """The steps that services are being asked for."""
    work: int | None = None
    look: Look | None = None
    phase: Phase = Phase.PLANNING
    workflow: Workflow | None = None
    request: PlanRequest | None = None
    plans: int = 0
    """How many were asked for."""
    replans: Replans = field(default_factory=Replans)
    """Plans since anything was completed."""
    waiting_for: WaitsForTasks | None = field(default=None, name="waits")
    """For whom, and what they have; it goes on when they have ended."""
    resumed: bool = field(default=False, name="goes_on")
    """It was waiting, and makes its plan as soon as it may."""
    fixed: bool = False
    """It has one plan and no other."""
    replan_because: tuple[str, ...] | None = None
    """Why the plan is given up as soon as nothing of it runs any more."""

    @classmethod
    def create(cls, owner: str, number: int, goal: str, kind: GoalKind, work: int | None = None, look: Look | None = None) -> GoalExecution:
        return cls(number=number, goal=goal, kind=kind, calls=OpenCalls(timer=BidsDue(owner, number)), work=work, look=look)

    def __iter__(self) -> Iterator[StepRun]:
        return iter(self.workflow or ())

    @property
    def label(self) -> str:
        """What the names of its steps begin with, for people."""
        return "" if self.kind is GoalKind.TASK else f"{self.kind}{self.number}."


class LoggedEvent(Struct, frozen=True):
    """An event. `step`: what people call the step that it is of; `goal`: what that is done for."""

    at: float
    event: Event
    step: str | None = None
    goal: GoalKind | None = None

    @property
    def kind(self) -> EventKind:
        return kind_of(self.event)


class LoggedMessage(Struct, frozen=True):
    """A message of the protocol."""

    at: float
    message: Message


class TaskState(Struct, kw_only=True, eq=False):
    """`client` is who wants it; `goal` what the task is for, `side_goals` what is pursued before that is gone on with: the last one is what
    goes on. `ending`: how it will end once everything under way has stopped, and is undone; `reasons`: why."""

    id: str
    task: Submit
    submitted_at: float
    client: str
    goal: GoalExecution
    side_goals: list[GoalExecution] = field(default_factory=list, name="aside")
    goal_count: int = field(default=1, name="goals")
    """How many goals there were."""
    outcome: Outcome | None = None
    ended_at: float | None = None
    ending: Outcome | None = None
    reasons: tuple[str, ...] = ()
    events: list[LoggedEvent] = []
    messages: list[LoggedMessage] = []
    """Of the protocol, until the end: then they are recorded."""
    message_count: int = field(default=0, name="passed")
    """How many there were."""
    setbacks: int = 0
    """How often something went wrong."""
    log: ExecutionLog = field(default_factory=ExecutionLog)
    members: Members = field(default_factory=Members)
    services: KnownServices = field(default_factory=KnownServices)
    reports: Reports = field(default_factory=Reports)
    look_queue: LookQueue = field(default_factory=LookQueue, name="looks")
    undoing: Undoing | None = None
    blocked: tuple[str, ...] = ()
    """Why there is no plan, while what failures left is undone."""

    @property
    def executions(self) -> Iterator[GoalExecution]:
        yield self.goal
        yield from self.side_goals

    @property
    def phase(self) -> Phase:
        """How far it is."""
        if self.outcome is not None:
            return Phase.ENDED
        if self.undoing is not None:
            return Phase.COMPENSATING
        if self.ending is not None or self.side_goals or self.look_queue.current_look is not None:
            return Phase.RECOVERING
        return self.goal.phase

    @property
    def latest_finish(self) -> float | None:
        """When all has to be done."""
        return self.submitted_at + self.task.deadline if self.task.deadline is not None and self.ending is None else None

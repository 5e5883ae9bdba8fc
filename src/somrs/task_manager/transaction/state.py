"""The state of one task, as data."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct, field

from somrs.planner.model.plan import Plan
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.event_kinds import EventKind, kind_of
from somrs.protocol.messages.event_text import retry_text, waiting_text
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.findings import Findings
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.previews import Previewed
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import Pause, Phase
from somrs.protocol.messages.waits import WaitsForRepository, WaitsForTasks, WaitsToRetry
from somrs.task_manager.arrangement.call_for_proposals import OpenCalls
from somrs.task_manager.arrangement.conditions import StatedConditions
from somrs.task_manager.arrangement.plan_request import PlanRequest
from somrs.task_manager.execution.execution_log import ExecutionLog
from somrs.task_manager.execution.member import Members
from somrs.task_manager.execution.reports import Reports
from somrs.task_manager.execution.workflow import StepRun, Workflow
from somrs.task_manager.known_services import KnownServices
from somrs.task_manager.recovery.compensation import Undoing
from somrs.task_manager.recovery.ladder import Replans
from somrs.task_manager.recovery.observation import Look, LookQueue
from somrs.task_manager.reservations import TaskReservation
from somrs.task_manager.timers import BidsDue


class Comparison(Struct, kw_only=True):
    """Several plans for a goal, by the ids of their quotes, and the quotes that have come."""

    plans: dict[str, Plan]
    previews: dict[str, Previewed] = {}
    chosen: str | None = None
    """The preferred plan, while its objects are being reserved."""


class GoalExecution(Struct, kw_only=True, eq=False):
    """The execution of one goal, a formula in Entish.

    For a goal other than the task's own, `work` is the number of the work that it concerns. `look` is its observation, if any.
    """

    number: int
    goal: str
    kind: GoalKind
    calls: OpenCalls
    """The open calls for proposals."""
    work: int | None = None
    look: Look | None = None
    phase: Phase = Phase.PLANNING
    workflow: Workflow | None = None
    outlook: Plan | None = None
    """The whole plan, if only the part up to what its steps tell is executed; the rest is planned again when that is known."""
    request: PlanRequest | None = None
    deferred_plan: Plan | None = None
    """A plan from the present situation, while work is undone first."""
    comparison: Comparison | None = None
    """The plans that are being compared."""
    plans: int = 0
    """The number of plans requested so far."""
    replans: Replans = field(default_factory=Replans)
    """Limits how often the goal is replanned."""
    waiting_for: WaitsForTasks | None = field(default=None, name="waits")
    """The tasks that the goal waits for, and the objects that they hold."""
    waiting_to_retry: WaitsToRetry | None = None
    """Why there was no way to reach the goal when this was last tried."""
    retry_at: float | None = None
    """When it is tried again; None while it is being tried."""
    resumed: bool = field(default=False, name="goes_on")
    """It has stopped waiting, and requests its plan next."""
    conditions: StatedConditions = field(default_factory=StatedConditions)
    """What services demanded for steps."""
    fixed: bool = False
    """Its plan was given, and is never replaced."""
    replan_because: tuple[str, ...] | None = None
    """Why the goal is replanned as soon as no step is executing."""

    @classmethod
    def create(cls, owner: str, number: int, goal: str, kind: GoalKind, work: int | None = None, look: Look | None = None) -> GoalExecution:
        return cls(number=number, goal=goal, kind=kind, calls=OpenCalls(timer=BidsDue(owner, number)), work=work, look=look)

    def __iter__(self) -> Iterator[StepRun]:
        return iter(self.workflow or ())

    @property
    def is_pending(self) -> bool:
        """Whether it has no plan to work on: the plan is being made, or the goal waits."""
        return any(reason is not None for reason in (self.request, self.comparison, self.waiting_for, self.retry_at))

    @property
    def label(self) -> str:
        """The prefix of its steps' names, for people."""
        return "" if self.kind is GoalKind.TASK else f"{self.kind}{self.number}."


def waiting_texts(execution: GoalExecution) -> tuple[str, ...]:
    """What the goal waits for, for people."""
    if execution.waiting_for is not None:
        return (waiting_text(execution.waiting_for),)
    return (retry_text(execution.waiting_to_retry),) if execution.waiting_to_retry is not None else ()


class LoggedEvent(Struct, frozen=True, gc=False):
    """An event of a task. `step` is the label of the step that it concerns, `goal` the kind of goal of that step."""

    at: float
    event: Event
    step: str | None = None
    goal: GoalKind | None = None

    @property
    def kind(self) -> EventKind:
        return kind_of(self.event)


class LoggedMessage(Struct, frozen=True, gc=False):
    """A protocol message that was sent or received."""

    at: float
    message: Message


class Attempt(Struct, kw_only=True):
    """A further attempt of a task that waits.

    It is quiet: its events and messages are held back, and dropped if it fails for the same reasons as the attempt before. `first_number`
    is the number of its first participant.
    """

    first_number: int
    events: list[LoggedEvent] = []
    messages: list[LoggedMessage] = []


class AwaitedAnswer(Struct, frozen=True):
    """The answer to the request with this id, and of whom it is."""

    request: str
    wait: WaitsForRepository


class TaskState(Struct, kw_only=True, eq=False):
    """The state of one task.

    `client` is the address of the client. `goal` is the task's own goal. `side_goals` are further goals, executed before it, the last one
    first. `ending` is the outcome that the task will have when its participants have stopped and its work is undone; `reasons` says why.
    """

    id: str
    task: Submit
    submitted_at: float
    client: str
    goal: GoalExecution
    side_goals: list[GoalExecution] = field(default_factory=list, name="aside")
    goal_count: int = field(default=1, name="goals")
    """The number of goals so far."""
    outcome: Outcome | None = None
    ended_at: float | None = None
    ending: Outcome | None = None
    reasons: tuple[str, ...] = ()
    events: list[LoggedEvent] = []
    messages: list[LoggedMessage] = []
    """Protocol messages, until the task ends. Then they are in its record."""
    message_count: int = field(default=0, name="passed")
    """The number of messages so far."""
    setbacks: int = 0
    """The number of setbacks so far."""
    log: ExecutionLog = field(default_factory=ExecutionLog)
    members: Members = field(default_factory=Members)
    services: KnownServices = field(default_factory=KnownServices)
    reports: Reports = field(default_factory=Reports)
    look_queue: LookQueue = field(default_factory=LookQueue, name="looks")
    attempt: Attempt | None = None
    undoing: Undoing | None = None
    findings: Findings | None = None
    """The answer to a client that asks what is so, when the task has ended."""
    blocked: tuple[str, ...] = ()
    """Why there is no plan, while interrupted work is being compensated."""
    reservation: TaskReservation = field(default_factory=TaskReservation)
    """The objects that the task has reserved."""
    awaited_answer: AwaitedAnswer | None = None
    """The answer of a Repository that is late."""
    pause: Pause | None = None
    """Who has paused the task."""
    due_time: float | None = None
    """When the task has to be accomplished, in the world's time; None without a deadline."""
    due_at: float | None = None
    """When that is by the wall's clock, as the world's time passes now; None: never, while that stands still."""
    held_devices: list[str] = []
    """The devices that stand still because the task is paused."""

    @classmethod
    def new(cls, id: str, task: Submit, now: float, client: str = "") -> TaskState:
        """The state of a task that was just submitted; `start` its transaction next."""
        goal = GoalExecution.create(id, 1, task.effect, GoalKind.TASK)
        return cls(id=id, task=task, submitted_at=now, client=client, goal=goal)

    @property
    def executions(self) -> Iterator[GoalExecution]:
        yield self.goal
        yield from self.side_goals

    @property
    def has_invariants(self) -> bool:
        """Whether something has to hold while services of the task work, by their types or their terms."""
        by_type = any(service_type.invariant is not None for service_type in self.services.types.values())
        return by_type or any(member.session.invariant is not None for member in self.members.working)

    @property
    def phase(self) -> Phase:
        """The current phase of the task."""
        if self.outcome is not None:
            return Phase.ENDED
        if self.undoing is not None:
            return Phase.COMPENSATING
        if self.ending is not None or self.side_goals or self.look_queue.current_look is not None:
            return Phase.RECOVERING
        return self.goal.phase

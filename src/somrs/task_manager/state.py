"""The state of a Task Manager, as one tree of data."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct, field

from somrs.kernel.replica import Replica
from somrs.kernel.reservations import Reservations
from somrs.kernel.service_replica import ServiceReplica
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.observations import Reception
from somrs.protocol.messages.reservations import Claim
from somrs.task_manager.context import Commitments, Interval, Quotes
from somrs.task_manager.device_queue import AtWork, DeviceQueues
from somrs.task_manager.discovery import Discovery
from somrs.task_manager.execution.reports import ReportResult
from somrs.task_manager.pace import Pace
from somrs.task_manager.preview_state import PreviewState
from somrs.task_manager.requests import Requests
from somrs.task_manager.subscriptions import Subscriptions
from somrs.task_manager.transaction.state import TaskState
from somrs.task_manager.world_clock import WorldClock

REMEMBERED = 200
"""The number of tasks in memory. Beyond that, the oldest ended tasks are dropped; the archive keeps their records."""


MOST_INVITATIONS = 1000
"""The number of services that are asked for terms at a time, by all tasks together, unless one task asks more. When hundreds of tasks ask
hundreds of services each at once, the answers come too late for all of them."""


class UnsettledReport(Struct, frozen=True, kw_only=True):
    """A task's report that is settled when the replica reaches `version`, and what became of it."""

    version: int
    task: str
    problems: tuple[str, ...] = ()
    reception: Reception = Reception()
    has_lost_reservation: bool = False

    @classmethod
    def of(cls, version: int, task: str, result: ReportResult) -> UnsettledReport:
        return cls(
            version=version,
            task=task,
            problems=result.problems,
            reception=result.reception,
            has_lost_reservation=result.has_lost_reservation,
        )

    @property
    def result(self) -> ReportResult:
        return ReportResult(problems=self.problems, reception=self.reception, has_lost_reservation=self.has_lost_reservation)


class TaskManagerState(Struct, kw_only=True):
    """The state of a Task Manager.

    `tasks` are all tasks in memory, `running` those that have not ended. `awaiting_map` and `awaiting_records` are clients'
    requests that wait for the map or for the archive, by message id. `local_reservations`: see `TaskManagerContext`.
    """

    replica: Replica
    requests: Requests
    discovery: Discovery = field(default_factory=Discovery)
    tasks: dict[str, TaskState] = field(default_factory=dict)
    running: list[str] = []
    previews: dict[str, PreviewState] = field(default_factory=dict)
    local_reservations: Reservations | None = None
    queues: DeviceQueues = field(default_factory=DeviceQueues)
    quotes: Quotes = field(default_factory=Quotes)
    pace: Pace = field(default_factory=Pace)
    clock: WorldClock = field(default_factory=WorldClock)
    subscriptions: Subscriptions = field(default_factory=Subscriptions)
    touched: dict[str, None] = {}
    waiting_to_ask: dict[str, None] = {}
    """The tasks that wait until fewer services are being asked for terms."""
    map_version: int = -1
    unsettled: list[UnsettledReport] = []
    awaiting_map: dict[str, Message] = field(default_factory=dict, name="until_ready")
    awaiting_records: dict[str, Message] = field(default_factory=dict, name="readers")
    awaiting_assignment: dict[str, Message] = field(default_factory=dict)
    """The submissions of which the Repository has not said yet whose they are, by their tasks."""

    @classmethod
    def new(cls, address: str, repository: str, registry: str) -> TaskManagerState:
        requests = Requests(address=address, repository=repository, registry=registry)
        discovery = Discovery(directory=ServiceReplica(address, registry))
        return cls(replica=Replica(address, repository), requests=requests, discovery=discovery)

    @property
    def running_tasks(self) -> Iterator[TaskState]:
        return (self.tasks[task] for task in self.running)

    def claims(self) -> Iterator[Claim]:
        """What all running tasks have reserved, or wait for."""
        for task in self.running_tasks:
            if (claim := task.reservation.claim(task.id, task.task.effect, task.task.priority)) is not None:
                yield claim

    def still_at_work(self, work: AtWork) -> bool:
        """Whether the device of a participant still carries out its last order."""
        task = self.tasks.get(work.transaction)
        return task is not None and task.members.at_work(work.participant)

    def reserved_elsewhere(self, id: str) -> frozenset[str]:
        """The objects that other tasks have reserved to change them."""
        return frozenset(name for task in self.running_tasks if task.id != id for name in task.reservation.held.changes)

    @property
    def invitations(self) -> int:
        """How many services are being asked for terms, by all tasks."""
        calls = (call for task in self.running_tasks for execution in task.executions for call in execution.calls)
        return sum(len(call.invited) for call in calls)

    def may_ask(self, id: str) -> bool:
        """Whether a task may ask services for terms now. Otherwise it may when it is one of `next_to_ask`."""
        if self.invitations < MOST_INVITATIONS:
            return True
        self.waiting_to_ask[id] = None
        return False

    def next_to_ask(self) -> Iterator[str]:
        """The tasks that waited to ask services and may do so now, by priority, then as they came. Each asks before the next is yielded."""
        while self.waiting_to_ask and self.invitations < MOST_INVITATIONS:
            id = max(self.waiting_to_ask, key=lambda id: self.tasks[id].task.priority if id in self.tasks else 0)
            del self.waiting_to_ask[id]
            if id in self.running:
                yield id

    def commitments(self) -> Commitments:
        """The intervals in which providers are committed."""
        commitments: dict[str, list[Interval]] = {}
        for task in self.running_tasks:
            for execution in task.executions:
                if execution.workflow is not None:
                    for provider in execution.workflow.providers:
                        commitments.setdefault(provider, []).extend(execution.workflow.promised(provider))
        return commitments

    def forget_old_tasks(self) -> None:
        """Drop the oldest ended tasks beyond `REMEMBERED`. The clients that watched them have received their outcome."""
        while len(self.tasks) > REMEMBERED and len(self.tasks) > len(self.running):
            oldest = next(id for id in self.tasks if id not in self.running)
            del self.tasks[oldest]
            self.subscriptions.forget(oldest)

"""The state of a Task Manager, as one tree of data."""

from __future__ import annotations

from collections.abc import Iterable

from msgspec import Struct, field

from somrs.kernel.replica import Replica
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.observations import Reception
from somrs.task_manager.context import Quotes
from somrs.task_manager.device_queue import DeviceQueues
from somrs.task_manager.execution.reports import ReportResult
from somrs.task_manager.pace import Pace
from somrs.task_manager.preview_state import PreviewState
from somrs.task_manager.requests import Requests
from somrs.task_manager.reservations import Reservations
from somrs.task_manager.subscriptions import Subscriptions
from somrs.task_manager.transaction.state import TaskState
from somrs.task_manager.world_clock import WorldClock


class UnsettledReport(Struct, frozen=True, kw_only=True):
    """A task's report that is settled when the replica reaches `version`, and what became of it."""

    version: int
    task: str
    problems: tuple[str, ...] = ()
    reception: Reception = Reception()

    @property
    def result(self) -> ReportResult:
        return ReportResult(problems=self.problems, reception=self.reception)


class TaskManagerState(Struct, kw_only=True):
    """The state of a Task Manager.

    `tasks` are all tasks in memory, `running` those that have not ended. `awaiting_map` and `awaiting_records` are clients'
    requests that wait for the map or for the archive, by message id.
    """

    replica: Replica
    requests: Requests
    tasks: dict[str, TaskState] = field(default_factory=dict)
    running: list[str] = []
    previews: dict[str, PreviewState] = field(default_factory=dict)
    reservations: Reservations = field(default_factory=Reservations)
    queues: DeviceQueues = field(default_factory=DeviceQueues)
    quotes: Quotes = field(default_factory=Quotes)
    pace: Pace = field(default_factory=Pace)
    clock: WorldClock = field(default_factory=WorldClock)
    subscriptions: Subscriptions = field(default_factory=Subscriptions)
    touched: dict[str, None] = {}
    map_version: int = -1
    unsettled: list[UnsettledReport] = []
    awaiting_map: dict[str, Message] = field(default_factory=dict, name="until_ready")
    awaiting_records: dict[str, Message] = field(default_factory=dict, name="readers")

    @classmethod
    def new(cls, address: str, repository: str, registry: str) -> TaskManagerState:
        return cls(replica=Replica(address, repository), requests=Requests(address=address, repository=repository, registry=registry))

    def overtake(self, task: str, objects: Iterable[str]) -> None:
        """Tell all other tasks that a task has changed objects."""
        for id in self.running:
            if id != task:
                self.tasks[id].log.overtake(objects)

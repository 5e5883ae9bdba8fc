"""The state of a Scheduler as one tree of data, its timers, and the notice of its program."""

from __future__ import annotations

from msgspec import Struct, field

from somrs.kernel.replica import Replica, ReplicaDue
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.records import ReadRecords
from somrs.protocol.messages.submission import Submit, SubmitOnce
from somrs.protocol.messages.task_news import WatchTask
from somrs.scheduling.book import Book


class OrdersDue(Struct, frozen=True, tag=True):
    """An order is due, a request is to be repeated, or the clock is to be checked."""


class MapDue(Struct, frozen=True, tag=True):
    """A request has waited too long for the map."""

    request: str


Timer = OrdersDue | ReplicaDue | MapDue


class Located(Struct, frozen=True, tag=True):
    """The addresses of the other components, and the machine's time zone by its name in the time zone database; an empty name stands for
    the machine's local time. `further_task_managers`: those besides `task_manager`, in a system with several."""

    repository: str
    task_manager: str
    zone: str = ""
    further_task_managers: tuple[str, ...] = ()

    @property
    def task_managers(self) -> tuple[str, ...]:
        return (self.task_manager, *self.further_task_managers)


class Question(Struct, frozen=True, kw_only=True):
    """An open request to a Task Manager, for the run of an order with this due time. `about`: the task of an earlier run, if the request
    is whether that still runs. `until`: when the request is repeated if there is no reply.

    `task_manager`: the address, in a system with several. `strangers`: those that do not know the task."""

    order: str
    due: float
    body: Submit | SubmitOnce | WatchTask | ReadRecords
    about: str | None = None
    until: float
    task_manager: str = ""
    strangers: tuple[str, ...] = ()


class SchedulerState(Struct, kw_only=True):
    """The state of a Scheduler. `located`: the latest notice of its program. `questions`: the open requests to the Task Manager, by message
    id; `question_count`: the number of requests so far, and `news_count` of news. `subscribers`: the ends of their leases, by address.
    `started_at`: the time of the last start. `until_ready`: the requests that wait for the map, by message id."""

    address: str = ""
    located: Located
    replica: Replica
    book: Book = field(default_factory=Book)
    questions: dict[str, Question] = field(default_factory=dict)
    question_count: int = field(default=0, name="asked")
    subscribers: dict[str, float] = field(default_factory=dict)
    news_count: int = field(default=0, name="told")
    started_at: float = field(default=0.0, name="begun")
    until_ready: dict[str, Message] = field(default_factory=dict)

    @classmethod
    def new(cls, address: str, located: Located) -> SchedulerState:
        return cls(address=address, located=located, replica=Replica(address, located.repository))

"""All that a Scheduler knows, as one tree of data; what wakes it; and what its program tells it."""

from __future__ import annotations

from msgspec import Struct, field

from somrs.kernel.replica import Replica, ReplicaDue
from somrs.protocol.messages.clients import Submit, WatchTask
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.records import ReadRecords
from somrs.scheduling.book import Book


class OrdersDue(Struct, frozen=True, tag=True):
    """An order is due, a question is to be asked again, or the time is to be looked at."""


class MapDue(Struct, frozen=True, tag=True):
    """A request has waited long for the map."""

    request: str


Timer = OrdersDue | ReplicaDue | MapDue


class Located(Struct, frozen=True, tag=True):
    """Where the other parts are, and in which zone the machine is, by its name in the time zone database; without one, the machine's
    own idea of local time counts."""

    repository: str
    task_manager: str
    zone: str = ""


class Question(Struct, frozen=True, kw_only=True):
    """What the Task Manager was asked for a time at which an order was due. `about`: a task of a time before, which may still run.
    `until`: when it is asked again, if nobody answered."""

    order: str
    due: float
    body: Submit | WatchTask | ReadRecords
    about: str | None = None
    until: float


class SchedulerState(Struct, kw_only=True):
    """`located` is what its program told it last. `questions` are those that are open, by the id of their message; `question_count` counts
    them, and `news_count` the news. `subscribers`: until when, by address. `started_at`: when it was started last. `until_ready`: requests
    that need the map, by message id."""

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

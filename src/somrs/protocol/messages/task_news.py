"""Reading and watching the tasks of a Task Manager, and their messages.

A task and its parts are in `task_views.py`; reading tasks that are over is in `records.py`.
"""

from __future__ import annotations

from somrs.protocol.messages.body import MessageBody
from somrs.protocol.messages.task_views import ContractView, MessageView, TaskEvent, TaskRow, TaskView


class ReadTasks(MessageBody, frozen=True, kw_only=True, tag=True):
    """Read the tasks that this Task Manager knows, newest first, up to `limit`.

    `running`: only those that are not over. `behind`: only those after this task in that order.
    """

    limit: int = 50
    running: bool = False
    behind: str | None = None


class Tasks(MessageBody, frozen=True, kw_only=True, tag=True):
    """A page of tasks. `more`: there are older tasks. `total`: the number of those that were asked for, on all pages.

    A page ends early when it becomes too long for a message. If a single plan is too long, the page has its first steps; TaskNews has all.
    """

    tasks: tuple[TaskView, ...]
    more: bool = False
    total: int | None = None


class WatchTasks(MessageBody, frozen=True, kw_only=True, tag=True):
    """Wait for a change of any task after the change with the number `after`; answer after `wait` seconds at the latest.

    With `after` 0, the answer has all known tasks.
    """

    after: int = 0
    wait: float = 20.0


class TasksNews(MessageBody, frozen=True, kw_only=True, tag=True):
    """The tasks that changed, as they are now, in the order of their changes.

    `version` is the number of the last of these changes: request the later ones with `after`. `more`: there are later ones already. `begun`
    is the time from which this Task Manager knows tasks; when it differs from the one before, earlier answers are out of date.
    """

    rows: tuple[TaskRow, ...]
    version: int
    begun: float
    more: bool = False


class WatchTask(MessageBody, frozen=True, kw_only=True, tag=True):
    """Wait for an event after the number `after`; answer after `wait` seconds at the latest.

    `messages`: answer also as soon as there are more messages of the protocol than this. `contracts`: answer also as soon as a contract
    changed after the change with this number. `parts`: omit this many of the view's steps and work, counted in this order.
    """

    task: str
    after: int = 0
    wait: float = 20.0
    messages: int | None = None
    contracts: int | None = None
    parts: int = 0


class TaskNews(MessageBody, frozen=True, kw_only=True, tag=True):
    """The task and its news.

    `more`: there are further events or contracts. `rest`: the view is too long for one message; request the others with `parts` set to this
    number. `messages` is their count. `contracts` are those that changed, if they were requested, and `contracts_at` is the number of the
    last of these changes. When a task is over, its contracts and messages are in its record.
    """

    view: TaskView
    events: tuple[TaskEvent, ...]
    more: bool = False
    messages: int = 0
    contracts: tuple[ContractView, ...] = ()
    contracts_at: int = 0
    rest: int | None = None


class ReadMessages(MessageBody, frozen=True, kw_only=True, tag=True):
    """Read the messages of a task, running or over, in the order in which they passed, without the first `after`."""

    task: str
    after: int = 0


class Messages(MessageBody, frozen=True, kw_only=True, tag=True):
    """A page of messages. `more`: there are further ones already."""

    messages: tuple[MessageView, ...]
    more: bool = False

"""Clients that wait for news of one task or of all tasks. Each receives only what it has not received yet."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping

from msgspec import Struct, field

from somrs.kernel.component import SetTimer
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.paging import PAGE_BYTES, fit_page, size
from somrs.protocol.messages.task_news import TaskNews, TasksNews, WatchTask, WatchTasks
from somrs.protocol.messages.task_views import ContractView
from somrs.task_manager.timers import NewsDue
from somrs.task_manager.transaction.state import TaskState
from somrs.task_manager.transaction.views import contract_view, event_view, row, view_in_parts

MOST_WAIT = 60.0
"""Maximum seconds that a client's request waits for news."""

Replies = Iterator[tuple[Message, Body] | SetTimer]
"""Requests with their replies, and timers."""


class Watcher(Struct, frozen=True):
    """A client that waits, and its query."""

    request: Message
    query: WatchTask | WatchTasks = field(name="wanted")


class Subscriptions(Struct, kw_only=True):
    """The waiting clients, by message id.

    `started_at`: since when the Task Manager has kept tasks. `changed`: the number of the last change of each task, in ascending order.
    """

    watchers: dict[str, Watcher] = field(default_factory=dict)
    started_at: float = field(default=0.0, name="begun")
    version: int = 0
    changed: dict[str, int] = {}

    def start(self, now: float) -> None:
        self.started_at = self.started_at or now

    def forget(self, id: str) -> None:
        """Drop a task that is not in memory any more. The clients that watched it have received its outcome."""
        self.changed.pop(id, None)


class TaskSubscriptions:
    """Serves the subscriptions to the tasks in memory. It has no state of its own."""

    def __init__(self, state: Subscriptions, tasks: Mapping[str, TaskState]) -> None:
        self._state, self._tasks = state, tasks

    def wait(self, request: Message, query: WatchTask | WatchTasks, now: float) -> Replies:
        """Reply as soon as there is news, or when the time is over."""
        if self.has_news(query) or query.wait <= 0:
            yield request, self._news(query)
            return
        id = request.header.message_id
        self._state.watchers[id] = Watcher(request, query)
        seconds = min(max(query.wait, 0.0), MOST_WAIT) if math.isfinite(query.wait) else MOST_WAIT
        yield SetTimer(NewsDue(id), now + seconds)

    def timer_fired(self, id: str) -> Replies:
        """Reply to a client whose waiting time is over."""
        if (watcher := self._state.watchers.pop(id, None)) is not None:
            yield watcher.request, self._news(watcher.query)

    def notify_watchers(self, touched: dict[str, None]) -> Replies:
        """Reply to the clients for which the changes of the `touched` tasks are news, and clear `touched`."""
        state = self._state
        for id in touched:
            if id in self._tasks:
                state.version += 1
                state.changed.pop(id, None)
                state.changed[id] = state.version
        # With many running tasks, most watchers wait for news of other tasks.
        concerned = [entry for entry in state.watchers.items() if isinstance(entry[1].query, WatchTasks) or entry[1].query.task in touched]
        touched.clear()
        for id, watcher in [entry for entry in concerned if self.has_news(entry[1].query)]:
            del state.watchers[id]
            yield SetTimer(NewsDue(id), None)
            yield watcher.request, self._news(watcher.query)

    def has_news(self, query: WatchTask | WatchTasks) -> bool:
        if isinstance(query, WatchTasks):
            return self._state.version != query.after
        task = self._tasks[query.task]
        return (
            task.outcome is not None
            or len(task.events) > query.after
            or (query.messages is not None and task.message_count > query.messages)
            or (query.contracts is not None and task.members.change_count > query.contracts)
        )

    def _news(self, query: WatchTask | WatchTasks) -> TaskNews | TasksNews:
        return _news(self._tasks[query.task], query) if isinstance(query, WatchTask) else self._rows(query)

    def _rows(self, query: WatchTasks) -> TasksNews:
        # A client with a later version received it from a Task Manager whose state is lost.
        state = self._state
        known_version = query.after if query.after <= state.version else 0
        changed: list[str] = []
        for id in reversed(state.changed):
            if state.changed[id] <= known_version:
                break
            changed.append(id)
        rows = tuple(fit_page(row(self._tasks[id]) for id in reversed(changed)))
        version = state.changed[rows[-1].task] if rows else state.version
        return TasksNews(rows=rows, version=version, begun=state.started_at, more=len(rows) < len(changed))


def _news(task: TaskState, query: WatchTask) -> TaskNews:
    """What the client has not received yet, as much of it as fits into a message."""
    task_view, rest = view_in_parts(task, max(query.parts, 0))
    event_offset, change_offset = max(query.after, 0), query.contracts or 0
    if rest is not None:
        return TaskNews(view=task_view, events=(), more=True, messages=task.message_count, contracts_at=change_offset, rest=rest)
    room = PAGE_BYTES - size(task_view)
    logged = (event_view(number, noted) for number, noted in enumerate(task.events[event_offset:], event_offset + 1))
    events = tuple(fit_page(logged, max_bytes=room))
    is_partial = event_offset + len(events) < len(task.events)
    changed: list[tuple[int, ContractView]] = []
    if query.contracts is not None and not is_partial and task.outcome is None:
        members = sorted(
            (member for member in task.members if member.change_number > change_offset), key=lambda member: member.change_number
        )
        views = ((member.change_number, contract_view(member)) for member in members)
        changed = [*fit_page(views, max_bytes=room - _size(events))]
        is_partial = len(changed) < len(members)
    return TaskNews(
        view=task_view,
        events=events,
        more=is_partial,
        messages=task.message_count,
        contracts=tuple(contract for _, contract in changed),
        contracts_at=changed[-1][0] if changed else change_offset,
    )


def _size(items: Iterable[object]) -> int:
    return sum(map(size, items))

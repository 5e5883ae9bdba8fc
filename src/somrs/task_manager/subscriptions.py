"""Clients that wait for news: of one task, or of all that are known. They hear what they have not heard yet, and no more than that."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping

from msgspec import Struct, field

from somrs.kernel.component import SetTimer
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.clients import ContractView, TaskNews, TasksNews, WatchTask, WatchTasks
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.paging import PAGE_BYTES, fit_page, size
from somrs.task_manager.timers import NewsDue
from somrs.task_manager.transaction.state import TaskState
from somrs.task_manager.transaction.views import contract_view, event_view, row, view_in_parts

MOST_WAIT = 60.0
"""Seconds that a client is let wait for news at most."""

Replies = Iterator[tuple[Message, Body] | SetTimer]
"""Requests and what is answered to them, and timers."""


class Watcher(Struct, frozen=True):
    """A client that waits, and what for."""

    request: Message
    wanted: WatchTask | WatchTasks


class Subscriptions(Struct, kw_only=True):
    """Who waits, by message id. `begun`: since when tasks are known here; `changed`: the number of the last change of each task, in the
    order of these numbers."""

    watchers: dict[str, Watcher] = field(default_factory=dict)
    begun: float = 0.0
    version: int = 0
    changed: dict[str, int] = {}

    def start(self, now: float) -> None:
        self.begun = self.begun or now

    def forget(self, id: str) -> None:
        """The task is not known here any more. Whoever watched it was told that it is over."""
        self.changed.pop(id, None)


class SubscriptionsOf:
    """The subscriptions to these tasks, which are those that are known. It has no state of its own."""

    def __init__(self, state: Subscriptions, tasks: Mapping[str, TaskState]) -> None:
        self._state, self._tasks = state, tasks

    def wait(self, request: Message, wanted: WatchTask | WatchTasks, now: float) -> Replies:
        """Answer as soon as there is something, or the time is over."""
        if self.has_news(wanted):
            yield request, self._news(wanted)
            return
        id = request.header.message_id
        self._state.watchers[id] = Watcher(request, wanted)
        seconds = min(max(wanted.wait, 0.0), MOST_WAIT) if math.isfinite(wanted.wait) else MOST_WAIT
        yield SetTimer(NewsDue(id), now + seconds)

    def ring(self, id: str) -> Replies:
        """Somebody's time is over."""
        if (watcher := self._state.watchers.pop(id, None)) is not None:
            yield watcher.request, self._news(watcher.wanted)

    def tell(self, touched: dict[str, None]) -> Replies:
        """Tell those for whom there is something; something happened to those that were `touched`, and no more after this."""
        state = self._state
        for id in touched:
            if id in self._tasks:
                state.version += 1
                state.changed.pop(id, None)
                state.changed[id] = state.version
        # With many tasks at a time, most watchers wait for news of others.
        concerned = [each for each in state.watchers.items() if isinstance(each[1].wanted, WatchTasks) or each[1].wanted.task in touched]
        touched.clear()
        for id, watcher in [each for each in concerned if self.has_news(each[1].wanted)]:
            del state.watchers[id]
            yield SetTimer(NewsDue(id), None)
            yield watcher.request, self._news(watcher.wanted)

    def has_news(self, wanted: WatchTask | WatchTasks) -> bool:
        if isinstance(wanted, WatchTasks):
            return self._state.version != wanted.after
        task = self._tasks[wanted.task]
        return (
            task.outcome is not None
            or len(task.events) > wanted.after
            or (wanted.messages is not None and task.passed > wanted.messages)
            or (wanted.contracts is not None and task.members.changes > wanted.contracts)
        )

    def _news(self, wanted: WatchTask | WatchTasks) -> TaskNews | TasksNews:
        return _news(self._tasks[wanted.task], wanted) if isinstance(wanted, WatchTask) else self._rows(wanted)

    def _rows(self, wanted: WatchTasks) -> TasksNews:
        # Whoever heard of changes that have not been yet heard them from a Task Manager that is forgotten.
        state = self._state
        after = wanted.after if wanted.after <= state.version else 0
        changed: list[str] = []
        for id in reversed(state.changed):
            if state.changed[id] <= after:
                break
            changed.append(id)
        rows = tuple(fit_page(row(self._tasks[id]) for id in reversed(changed)))
        version = state.changed[rows[-1].task] if rows else state.version
        return TasksNews(rows=rows, version=version, begun=state.begun, more=len(rows) < len(changed))


def _news(task: TaskState, wanted: WatchTask) -> TaskNews:
    """What the client has not heard yet, as much of it as fits a message."""
    seen, rest = view_in_parts(task, max(wanted.parts, 0))
    after, since = max(wanted.after, 0), wanted.contracts or 0
    if rest is not None:
        return TaskNews(view=seen, events=(), more=True, messages=task.passed, contracts_at=since, rest=rest)
    room = PAGE_BYTES - size(seen)
    logged = (event_view(number, noted) for number, noted in enumerate(task.events[after:], after + 1))
    events = tuple(fit_page(logged, max_bytes=room))
    more = after + len(events) < len(task.events)
    changed: list[tuple[int, ContractView]] = []
    if wanted.contracts is not None and not more and task.outcome is None:
        members = sorted((member for member in task.members if member.changed > since), key=lambda member: member.changed)
        views = ((member.changed, contract_view(member)) for member in members)
        changed = [*fit_page(views, max_bytes=room - _size(events))]
        more = len(changed) < len(members)
    return TaskNews(
        view=seen,
        events=events,
        more=more,
        messages=task.passed,
        contracts=tuple(contract for _, contract in changed),
        contracts_at=changed[-1][0] if changed else since,
    )


def _size(items: Iterable[object]) -> int:
    return sum(map(size, items))

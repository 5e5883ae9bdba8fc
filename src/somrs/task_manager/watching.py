"""Clients that wait for news: of one task, or of all that are known. They hear what they have not heard yet, and no more than that."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from somrs.kernel.component import Effect, Wake
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.clients import ContractView, TaskNews, TasksNews, WatchTask, WatchTasks
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.paging import PAGE_BYTES, fitting, size
from somrs.task_manager.transaction import Transaction
from somrs.task_manager.views import contract_view, row, view_in_parts

MOST_WAIT = 60.0
"""Seconds that a client is let wait for news at most."""

TIMER = "watch"

Reply = Callable[[Message, Body], None]


@dataclass(frozen=True, slots=True)
class _Watcher:
    """A client that waits, and what for."""

    request: Message
    wanted: WatchTask | WatchTasks


@dataclass(slots=True, kw_only=True)
class Watching:
    """`transactions` are those that are known, `touched` those to which something happened since they were told of."""

    transactions: Mapping[str, Transaction]
    touched: dict[str, None]
    effects: list[Effect]
    reply: Reply
    begun: float = 0.0
    """Since when tasks are known here."""
    _watchers: dict[str, _Watcher] = field(default_factory=dict)
    _version: int = 0
    _changed: dict[str, int] = field(default_factory=dict)
    """The number of the last change of each task, in the order of these numbers."""

    def start(self, now: float) -> None:
        self.begun = self.begun or now

    def wait(self, request: Message, wanted: WatchTask | WatchTasks, now: float) -> None:
        """Answer as soon as there is something, or the time is over."""
        id = request.header.message_id
        self._watchers[id] = _Watcher(request, wanted)
        seconds = min(max(wanted.wait, 0.0), MOST_WAIT) if math.isfinite(wanted.wait) else MOST_WAIT
        self.effects.append(Wake(f"{TIMER} {id}", now + seconds))

    def ring(self, id: str) -> None:
        """Somebody's time is over."""
        if (watcher := self._watchers.pop(id, None)) is not None:
            self._tell(watcher)

    def tell(self) -> None:
        """Tell those for whom there is something."""
        for id in self.touched:
            if id in self.transactions:
                self._version += 1
                self._changed.pop(id, None)
                self._changed[id] = self._version
        self.touched.clear()
        due = [(id, watcher) for id, watcher in self._watchers.items() if self._has_news(watcher.wanted)]
        for id, watcher in due:
            del self._watchers[id]
            self.effects.append(Wake(f"{TIMER} {id}", None))
            self._tell(watcher)

    def forget(self, id: str) -> None:
        """The task is not known here any more. Whoever watched it was told that it is over."""
        self._changed.pop(id, None)

    def _has_news(self, wanted: WatchTask | WatchTasks) -> bool:
        if isinstance(wanted, WatchTasks):
            return self._version != wanted.after
        transaction = self.transactions[wanted.task]
        return (
            transaction.outcome is not None
            or len(transaction.events) > wanted.after
            or (wanted.messages is not None and transaction.passed > wanted.messages)
            or (wanted.contracts is not None and transaction.participants.changes > wanted.contracts)
        )

    def _tell(self, watcher: _Watcher) -> None:
        match watcher.wanted:
            case WatchTask() as wanted:
                self.reply(watcher.request, _news(self.transactions[wanted.task], wanted))
            case WatchTasks() as wanted:
                self.reply(watcher.request, self._rows(wanted))

    def _rows(self, wanted: WatchTasks) -> TasksNews:
        # Whoever heard of changes that have not been yet heard them from a Task Manager that is forgotten.
        after = wanted.after if wanted.after <= self._version else 0
        changed: list[str] = []
        for id in reversed(self._changed):
            if self._changed[id] <= after:
                break
            changed.append(id)
        rows = tuple(fitting(row(self.transactions[id]) for id in reversed(changed)))
        version = self._changed[rows[-1].task] if rows else self._version
        return TasksNews(rows=rows, version=version, begun=self.begun, more=len(rows) < len(changed))


def _news(transaction: Transaction, wanted: WatchTask) -> TaskNews:
    """What the client has not heard yet, as much of it as fits a message."""
    seen, rest = view_in_parts(transaction, max(wanted.parts, 0))
    after, since = max(wanted.after, 0), wanted.contracts or 0
    if rest is not None:
        return TaskNews(view=seen, events=(), more=True, messages=transaction.passed, contracts_at=since, rest=rest)
    room = PAGE_BYTES - size(seen)
    events = tuple(fitting(transaction.events[after:], room=room))
    more = after + len(events) < len(transaction.events)
    changed: list[tuple[int, ContractView]] = []
    if wanted.contracts is not None and not more and transaction.outcome is None:
        members = sorted((member for member in transaction.participants if member.changed > since), key=lambda member: member.changed)
        views = ((member.changed, contract_view(member)) for member in members)
        changed = [*fitting(views, room=room - _size(events))]
        more = len(changed) < len(members)
    return TaskNews(
        view=seen,
        events=events,
        more=more,
        messages=transaction.passed,
        contracts=tuple(contract for _, contract in changed),
        contracts_at=changed[-1][0] if changed else since,
    )


def _size(items: Iterable[object]) -> int:
    return sum(map(size, items))

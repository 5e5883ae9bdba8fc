"""The news of tasks. For each topic, one long-polling request waits at the Task Manager, however many subscribers there are.

A subscriber reads the task or the list once after it has subscribed, and merges the news: events by number, contracts by participant.
"""

from __future__ import annotations

import asyncio
import contextlib

import msgspec

from somrs.client.client import Client
from somrs.client.hub import Hub
from somrs.client.task_history import TaskHistory
from somrs.errors import RemoteError
from somrs.protocol.messages.records import ReadRecords
from somrs.protocol.messages.task_news import TasksNews, WatchTask, WatchTasks
from somrs.protocol.messages.task_views import ContractView, Phase, TaskEvent, TaskRow, TaskView
from somrs.runtime.wire import Unanswered

WAIT = 20.0
"""Seconds for which a request waits for news."""

PAUSE = 0.2
"""Minimum seconds between two requests; events in between are reported together."""

PAUSE_PER_PART = 0.005
"""Additional seconds per step and piece of work, since all news contain them and a plan may have hundreds of steps."""

RETRY_DELAY = 1.0
"""Seconds before the next request to a Task Manager that did not answer."""


FIRST_READS = 8
"""Number of tasks that are read at the same time because somebody begins to follow them, so that other requests are answered between."""


class TasksChanged(msgspec.Struct, frozen=True, kw_only=True):
    """News of the topic `tasks`: the new and changed tasks as they are now. `anew`: the list is complete; discard all other tasks."""

    rows: tuple[TaskRow, ...]
    anew: bool = False


class TaskChanged(msgspec.Struct, frozen=True, kw_only=True):
    """News of the topic `task ID`: the task as it is now, the events since the previous news, the contracts that changed, and the total
    number of messages."""

    view: TaskView
    events: tuple[TaskEvent, ...] = ()
    contracts: tuple[ContractView, ...] = ()
    messages: int = 0


class TaskFeed:
    """The feeds of the topics `tasks` and `task ID`."""

    def __init__(self, client: Client, hub: Hub) -> None:
        self._client, self._hub = client, hub
        self._first_reads = asyncio.Semaphore(FIRST_READS)
        hub.feed("tasks", self._tasks)
        hub.feed("task", self._task)

    async def _tasks(self, topic: str) -> None:
        names = [*self._client.task_managers.addresses]
        rows_by_name: dict[str, dict[str, TaskRow]] = {name: {} for name in names}
        async with asyncio.TaskGroup() as group:
            for name in names:
                group.create_task(self._tasks_of(name, rows_by_name, topic))

    async def _tasks_of(self, name: str, rows_by_name: dict[str, dict[str, TaskRow]], topic: str) -> None:
        """Publish the changes of the tasks of one Task Manager. `rows_by_name`: the tasks of all of them, as far as they are known."""
        version = 0
        started_at: float | None = None
        while True:
            try:
                news = await self._list(WatchTasks(after=version, wait=WAIT), name)
                anew = news.begun != started_at
                if anew and started_at is not None:
                    news = await self._list(WatchTasks(after=0, wait=0), name)
            except RemoteError:
                await asyncio.sleep(RETRY_DELAY)
                continue
            rows_by_name[name] = ({} if anew else rows_by_name[name]) | {row.task: row for row in news.rows}
            if anew:
                rows = tuple(row for rows in rows_by_name.values() for row in rows.values())
                # At the start, the lists of the others may not be known yet.
                self._hub.publish(topic, TasksChanged(rows=rows, anew=started_at is not None or len(rows_by_name) == 1))
            elif news.rows:
                self._hub.publish(topic, TasksChanged(rows=news.rows))
            version, started_at = news.version, news.begun
            await asyncio.sleep(PAUSE)

    async def _list(self, request: WatchTasks, name: str) -> TasksNews:
        """All pages of the news."""
        news = await self._client.watch_list(request, name)
        while news.more:
            page = await self._client.watch_list(WatchTasks(after=news.version, wait=0), name)
            rows_by_task = {row.task: row for row in (*news.rows, *page.rows)}
            news = msgspec.structs.replace(page, rows=tuple(rows_by_task.values()))
        return news

    async def _task(self, topic: str) -> None:
        id = topic.partition(" ")[2]
        events = messages = contracts = 0
        wait = 0.0
        while True:
            request = WatchTask(task=id, after=events, wait=wait, messages=messages, contracts=contracts)
            try:
                async with contextlib.nullcontext() if wait else self._first_reads:
                    news = await self._client.watch(request)
                wait = WAIT
                has_ended = news.view.phase is Phase.ENDED
                changed = await final_contracts(self._client, id) if has_ended and not news.more else news.contracts
            except Unanswered:
                await asyncio.sleep(RETRY_DELAY)
                continue
            except RemoteError:  # the Task Manager no longer holds the task
                self._hub.publish(topic, missed=True)
                return
            if news.messages != messages or news.events or changed:
                self._hub.publish(topic, TaskChanged(view=news.view, events=news.events, contracts=changed, messages=news.messages))
            events, messages, contracts = events + len(news.events), news.messages, news.contracts_at
            if has_ended and not news.more:
                return
            if not news.more:
                await asyncio.sleep(PAUSE + PAUSE_PER_PART * (len(news.view.steps) + len(news.view.work)))


async def final_contracts(client: Client, task: str) -> tuple[ContractView, ...]:
    """The contracts of an ended task, from its record."""
    query = ReadRecords(task=task, without=("steps", "work", "events", "messages"))
    records = await TaskHistory(client.records).first(query, 1)
    return records[0].contracts if records else ()

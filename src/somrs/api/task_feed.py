"""The news of tasks, for whoever listens to them: one question at a time waits at the Task Manager, however many listen.

Who listens reads the task, or the list, once after that, and puts the news on top: events have numbers, contracts their participants.
"""

from __future__ import annotations

import asyncio

import msgspec

from somrs.client.client import Client
from somrs.client.hub import Hub
from somrs.client.task_history import TaskHistory
from somrs.errors import RemoteError
from somrs.protocol.messages.clients import ContractView, Phase, TaskEvent, TaskRow, TasksNews, TaskView, WatchTask, WatchTasks
from somrs.protocol.messages.records import ReadRecords
from somrs.runtime.wire import Unanswered

WAIT = 20.0
"""Seconds that a question waits for news."""

PAUSE = 0.2
"""Seconds between two questions at least: what happens in between is told together."""

PAUSE_PER_PART = 0.005
"""Seconds more for each step, and each piece of work, that every news shows: those of a plan of hundreds of steps are long."""

RETRY_DELAY = 1.0
"""Seconds after which a Task Manager that did not answer is asked again."""


class TasksChanged(msgspec.Struct, frozen=True, kw_only=True):
    """News of the topic `tasks`: those that changed, or came, as they are now. `anew`: these are all; forget the others."""

    rows: tuple[TaskRow, ...]
    anew: bool = False


class TaskChanged(msgspec.Struct, frozen=True, kw_only=True):
    """News of the topic `task ID`: the task as it is now, what happened since the news before, the contracts that changed, and how many
    messages there are by now."""

    view: TaskView
    events: tuple[TaskEvent, ...] = ()
    contracts: tuple[ContractView, ...] = ()
    messages: int = 0


class TaskFeed:
    """The feeds of the topics `tasks` and `task ID`."""

    def __init__(self, client: Client, hub: Hub) -> None:
        self._client, self._hub = client, hub
        hub.feed("tasks", self._tasks)
        hub.feed("task", self._task)

    async def _tasks(self, topic: str) -> None:
        version = 0
        started_at: float | None = None
        while True:
            try:
                news = await self._list(WatchTasks(after=version, wait=WAIT))
                anew = news.begun != started_at
                if anew and started_at is not None:
                    news = await self._list(WatchTasks(after=0, wait=0))
            except RemoteError:
                await asyncio.sleep(RETRY_DELAY)
                continue
            if news.rows or anew:
                self._hub.publish(topic, TasksChanged(rows=news.rows, anew=anew))
            version, started_at = news.version, news.begun
            await asyncio.sleep(PAUSE)

    async def _list(self, request: WatchTasks) -> TasksNews:
        """The news, all pages of them."""
        news = await self._client.watch_list(request)
        while news.more:
            page = await self._client.watch_list(WatchTasks(after=news.version, wait=0))
            rows_by_task = {row.task: row for row in (*news.rows, *page.rows)}
            news = msgspec.structs.replace(page, rows=tuple(rows_by_task.values()))
        return news

    async def _task(self, topic: str) -> None:
        id = topic.partition(" ")[2]
        events = messages = contracts = 0
        while True:
            request = WatchTask(task=id, after=events, wait=WAIT, messages=messages, contracts=contracts)
            try:
                news = await self._client.watch(request)
                has_ended = news.view.phase is Phase.ENDED
                changed = await final_contracts(self._client, id) if has_ended and not news.more else news.contracts
            except Unanswered:
                await asyncio.sleep(RETRY_DELAY)
                continue
            except RemoteError:  # it is not known there any more
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
    """Who was asked in a task that is over, and what became of it."""
    query = ReadRecords(task=task, without=("steps", "work", "events", "messages"))
    records = await TaskHistory(client.records).first(query, 1)
    return records[0].contracts if records else ()

"""The client of a running system, for programs in Python: `from somrs import Client`.

It is a thin layer over the API: `api` has every operation that there is. See docs/tutorials/ten-line-client.md.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterable
from pathlib import Path
from types import TracebackType

from somrs.api.remote import TOPICS, Api
from somrs.api.task_feed import TaskChanged
from somrs.client.api_client import ApiClient, address_of
from somrs.client.client import Addresses
from somrs.client.hub import News
from somrs.client.live_news import LiveHub
from somrs.errors import UsageError
from somrs.ontology.services import Handler
from somrs.protocol.messages.clients import Phase, Policy, Preview, Previewed, Submit, TaskRow, TaskView

DATA_FOLDER = Path(".somrs")
"""Where `somrs up` keeps the addresses of its system, unless told otherwise."""


class Client:
    """A running system: submit tasks, watch them, query the map, and follow what changes.

    An asynchronous context manager, for one event loop:

        async with Client() as system:
            task = await system.submit("Jar002 isOn Platform001")
            async for view in system.watch(task):
                print(view.phase, view.explanation)

    Args:
        system: the address of the API (`http://127.0.0.1:8800/api`), or the data folder of the system that `somrs up` started.

    Raises:
        UsageError: from `async with`, when no system runs there, or one without the API.
        RemoteError: from every method, when the system does not answer, or could not do what it was asked for.
        InputError: from every method, when what was asked for makes no sense; the message says where and why.
    """

    def __init__(self, system: str | Path = DATA_FOLDER) -> None:
        self._system = system

    async def __aenter__(self) -> Client:
        url = self._system if isinstance(self._system, str) and "://" in self._system else address_of(Addresses.read(Path(self._system)))
        self._exit_stack = contextlib.AsyncExitStack()
        self._api_client = await self._exit_stack.enter_async_context(ApiClient(url.rstrip("/")))
        self.api = Api(self._api_client)
        """All operations of the API, by part: `client.api.map.events()`."""
        self._hub: LiveHub | None = None
        return self

    async def __aexit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        await self._exit_stack.__aexit__(kind, error, traceback)

    async def submit(
        self,
        goal: str,
        *,
        precondition: str | None = None,
        policy: Policy = Policy.PRICE,
        time_value: float = 0.01,
        deadline: float | None = None,
        handlers: Iterable[Handler] = (),
        priority: int = 0,
        idempotency_key: str | None = None,
    ) -> str:
        """Submit a task, and return its id at once; `watch` follows it.

        Args:
            goal: the formula in Entish that is to hold, such as `Jar002 isOn Platform001`.
            precondition: a formula that has to hold now.
            policy: how services are chosen: by price, by time, or by both with `time_value` (EUR per second).
            deadline: seconds within which the task has to be accomplished.
            handlers: what is to be made true when a step fails; they go before those of the service types.
            priority: of tasks that need the same objects or devices, the one with the higher number goes first.
            idempotency_key: a task that is submitted again with the same key is the same task.
        """
        task = Submit(
            effect=goal,
            precondition=precondition,
            policy=policy,
            time_value=time_value,
            deadline=deadline,
            handlers=tuple(handlers),
            priority=priority,
        )
        return (await self.api.tasks.submit(task, once=idempotency_key)).task

    async def watch(self, task: str) -> AsyncIterator[TaskView]:
        """The task as it is now, and again whenever something about it changed; the last one has the phase ENDED and an outcome.

        Args:
            task: its id, or the beginning of it.
        """
        id = (await self.api.tasks.read(task)).view.task
        with (hub := self._live_hub()).subscribe(f"task {id}") as subscription:
            await hub.wait_until_followed(frozenset({f"task {id}"}))
            view = (await self.api.tasks.read(id)).view
            yield view
            while view.phase is not Phase.ENDED:
                news = await subscription.next_news()
                view = news.value.view if isinstance(news.value, TaskChanged) else (await self.api.tasks.read(id)).view
                yield view

    async def follow(self, *topics: str) -> AsyncIterator[News]:
        """News of these topics from now on, until the iteration is left: `map`, `ontology`, `services`, `fleet`, `tasks`, `questions`,
        `system`, and `task ID`. `news.missed`: some were lost, with a connection or because they were not taken in time; read again what
        the topic is about."""
        if unknown := sorted(topic for topic in topics if topic.partition(" ")[0] not in TOPICS):
            raise UsageError(f"there is no topic {unknown[0]}; the topics are {', '.join(TOPICS)}, and `task ID` for one task")
        with (hub := self._live_hub()).subscribe(*topics) as subscription:
            await hub.wait_until_followed(frozenset(topics))
            async for news in subscription:
                yield news

    async def query(self, formula: str, limit: int = 100) -> list[dict[str, str]]:
        """Every way in which a formula holds on the map, up to `limit`: the objects and values of its variables, by name without `?`.

        A formula without variables has one empty way when it holds, and none when it does not.
        """
        return [dict(row.bindings) for row in (await self.api.map.query(formula, limit)).rows]

    async def plan(self, goal: str, *, quotes: bool = False) -> Previewed:
        """The plan for a goal, without carrying it out; with `quotes`, what services would ask for it now."""
        return await self.api.tasks.preview(Preview(effect=goal, quotes=quotes))

    async def tasks(self, *, running: bool = False, limit: int = 50) -> tuple[TaskRow, ...]:
        """The tasks that the Task Manager knows, newest first: all, or those that are not over."""
        return (await self.api.tasks.list(running=running, limit=limit)).rows

    async def cancel(self, task: str, reason: str = "cancelled by the client") -> None:
        """Stop what runs, and have undone what was done."""
        await self.api.tasks.cancel(task, reason)

    def _live_hub(self) -> LiveHub:
        if self._hub is None:
            self._hub = LiveHub(self._api_client, TOPICS, _NoCopy(), always=frozenset())
            running = asyncio.create_task(self._hub.run())
            self._exit_stack.push_async_callback(_cancel, running)
        return self._hub


class _NoCopy:
    """Nothing is kept up to date here: whoever follows a topic reads what it is about."""

    async def read(self) -> None:
        pass

    async def apply_news(self, news: News) -> None:
        pass


async def _cancel(running: asyncio.Task[None]) -> None:
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)

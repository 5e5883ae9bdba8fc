"""The client of a running system, for programs in Python: `from somrs import Client`.

It is a thin layer over the API; `Client.api` has all operations. See docs/tutorials/ten-line-client.md.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterable
from pathlib import Path
from types import TracebackType

from somrs.api.remote import Api
from somrs.api.task_feed import TaskChanged
from somrs.api.topics import TOPICS, unknown_topics_text
from somrs.client.addresses import Addresses
from somrs.client.api_client import ApiClient, address_of, local_token_reader, token_of_environment
from somrs.client.hub import News
from somrs.client.live_news import LiveHub
from somrs.errors import UsageError
from somrs.ontology.services import Handler
from somrs.protocol.messages.findings import Findings
from somrs.protocol.messages.previews import Preview, Previewed
from somrs.protocol.messages.submission import Policy, Submit
from somrs.protocol.messages.task_views import Phase, TaskRow, TaskView

DATA_FOLDER = Path(".somrs")
"""The default data folder of `somrs up`, which contains the addresses of the system."""


class Client:
    """A client of a running system: submit tasks, watch them, query the map, and follow changes.

    An asynchronous context manager, for one event loop:

        async with Client() as system:
            task = await system.submit("Jar002 isOn Platform001")
            async for view in system.watch(task):
                print(view.phase, view.explanation)

    Args:
        system: the address of the API (`http://127.0.0.1:8800/api`), or the data folder of the system that `somrs up` started.
        token: what proves who the program is, made by `somrs token new`. By default that of the environment variable `SOMRS_TOKEN`, or
            that of the data folder.

    Raises:
        UsageError: from `async with`, if no system runs there, or if it has no API.
        RemoteError: from every method, if the system does not answer, or cannot carry out the request.
        InputError: from every method, if the request is invalid; the message says where and why.
    """

    def __init__(self, system: str | Path = DATA_FOLDER, token: str | None = None) -> None:
        self._system, self._token = system, token

    async def __aenter__(self) -> Client:
        if isinstance(self._system, str) and "://" in self._system:
            url, token_reader = self._system, token_of_environment
        else:
            url, token_reader = address_of(Addresses.read(Path(self._system))), local_token_reader(Path(self._system))
        own_token = self._token
        api_client = ApiClient(url.rstrip("/"), token_reader if own_token is None else lambda: own_token)
        self._exit_stack = contextlib.AsyncExitStack()
        self._api_client = await self._exit_stack.enter_async_context(api_client)
        self.api = Api(self._api_client)
        """All operations of the API, by group: `client.api.map.events()`."""
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
        waits: bool = True,
        idempotency_key: str | None = None,
        task_manager: str | None = None,
    ) -> str:
        """Submit a task, and return its id at once; `watch` follows the task.

        Args:
            goal: the Entish formula that the task is to make true, such as `Jar002 isOn Platform001`.
            precondition: a formula that has to hold when the task is submitted.
            policy: how services are chosen: by price, by time, or by both with `time_value` (EUR per second).
            time_value: what a second is worth, in EUR, under the weighted policy.
            deadline: seconds within which the task has to be accomplished.
            handlers: goals for when a step fails; they take precedence over the handlers of the service types.
            priority: among tasks that need the same objects or devices, the one with the higher number goes first.
            waits: while no service can do it, for reasons that pass, the task waits and tries again; otherwise it fails.
            idempotency_key: submissions with the same key are one task, so that a submission can be repeated after a timeout.
            task_manager: the name of the Task Manager that is to have it; by default, any of them takes it.
        """
        task = Submit(
            effect=goal,
            precondition=precondition,
            policy=policy,
            time_value=time_value,
            deadline=deadline,
            handlers=tuple(handlers),
            priority=priority,
            waits=waits,
        )
        return (await self.api.tasks.submit(task, once=idempotency_key, task_manager=task_manager)).task

    async def look(self, formula: str, *, policy: Policy = Policy.PRICE, deadline: float | None = None) -> str:
        """Submit a task that finds out for which objects and values the formula holds, and return its id at once; `findings` waits for the
        answer. Cognitive services observe it; nothing is moved.

        Args:
            formula: an Entish formula, such as `?Jar: Jar isOn Table001` or `Jar001.Weight = ?Weight`.
            policy: how services are chosen.
            deadline: seconds within which it has to be found out.
        """
        task = Submit(effect=formula, policy=policy, deadline=deadline, waits=deadline is not None, recognise=True)
        return (await self.api.tasks.submit(task)).task

    async def findings(self, task: str) -> Findings:
        """Wait until a task of `look` has ended, and return its findings: the answers, who saw them, and when.

        Raises:
            UsageError: the task is to make something so, and has no findings.
        """
        async for _ in self.watch(task):
            pass
        return await self.api.tasks.findings(task)

    async def watch(self, task: str) -> AsyncIterator[TaskView]:
        """Yield the task as it is now, and again after each change; the last view has the phase `ENDED` and an outcome.

        Args:
            task: the task's id, or the beginning of it.
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
        """Yield the news of these topics from now on. The topics are those of the API's WebSocket: `map`, `tasks`, `task ID`, `fleet`, ...

        If `news.missed` is true, news of the topic were lost, because the connection was interrupted or the iteration was too slow: read
        the subject of the topic again.

        Raises:
            UsageError: there is no such topic.
        """
        if problem := unknown_topics_text(topics):
            raise UsageError(problem)
        with (hub := self._live_hub()).subscribe(*topics) as subscription:
            await hub.wait_until_followed(frozenset(topics))
            async for news in subscription:
                yield news

    async def query(self, formula: str, limit: int = 100) -> list[dict[str, str]]:
        """Return the bindings of the formula's variables for which it holds on the map, at most `limit`.

        The keys of a binding are the variables' names without `?`. For a formula without variables, the result is one empty binding if it
        holds, and an empty list otherwise.
        """
        return [dict(row.bindings) for row in (await self.api.map.query(formula, limit)).rows]

    async def plan(self, goal: str, *, quotes: bool = False) -> Previewed:
        """Return a plan for the goal without executing it; with `quotes`, also the terms that services would offer now."""
        return await self.api.tasks.preview(Preview(effect=goal, quotes=quotes))

    async def tasks(self, *, running: bool = False, limit: int = 50) -> tuple[TaskRow, ...]:
        """Return the newest `limit` tasks that the Task Manager holds, newest first: all, or only those that have not ended.
        `api.tasks.list` reads further pages."""
        return (await self.api.tasks.list(running=running, limit=limit)).rows

    async def cancel(self, task: str, reason: str = "cancelled by the client") -> None:
        """Cancel a task: stop its running steps, and compensate the completed ones."""
        await self.api.tasks.cancel(task, reason)

    async def retry(self, task: str, *, idempotency_key: str | None = None) -> str:
        """Submit an ended task once more, with the same goal and options, and return the id of the new task."""
        return (await self.api.tasks.retry(task, once=idempotency_key)).task

    def _live_hub(self) -> LiveHub:
        if self._hub is None:
            self._hub = LiveHub(self._api_client, TOPICS, _NoCopy(), always=frozenset())
            running = asyncio.create_task(self._hub.run())
            self._exit_stack.push_async_callback(_cancel, running)
        return self._hub


class _NoCopy:
    """An empty copy for `LiveHub`: this client keeps no replica of the map."""

    async def read(self) -> None:
        pass

    async def apply_news(self, news: News) -> None:
        pass


async def _cancel(running: asyncio.Task[None]) -> None:
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)

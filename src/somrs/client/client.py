"""The client of the system's components (Repository, Registry, Task Managers, Scheduler): one request, one reply."""

from __future__ import annotations

import uuid
from collections.abc import AsyncIterator, Awaitable, Callable
from itertools import chain
from typing import TypeVar

import msgspec

from somrs.access.identity import user_of_process
from somrs.client.addresses import Addresses
from somrs.client.credentials import credentials_for
from somrs.client.task_managers import READ_TIME, Answers, Listing, TaskManagers, first_answer
from somrs.errors import FormulaError, RemoteError, UsageError
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.types import Definition, Ontology
from somrs.protocol.messages import directory, frp, knowledge, previews, records, reservations, submission, task_news, task_views
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.neighbours import Neighbours, ReadNeighbours
from somrs.protocol.messages.people import client_address
from somrs.runtime.wire import Unanswered, Wire, retry_unanswered

PAGE = 50
"""Number of tasks requested at once."""

NOBODY = "-"
"""The name of a provider that offers nothing: the Registry returns an empty page quickly."""

PATIENCE = 30.0
"""Seconds for which a client with a task waits for a Task Manager that is being restarted."""

Answer = TypeVar("Answer")

Post = Callable[[Message, float], Awaitable[Message | None]]
Shown = TypeVar("Shown", task_views.TaskView, task_views.TaskRow)


class Refused(RemoteError):
    """The Repository rejected a change, for these `problems`. `broken`: the rules that it would break, each with what it concerns."""

    def __init__(self, rejected: knowledge.Rejected) -> None:
        self.problems, self.broken, self.version = rejected.problems, rejected.broken, rejected.version
        super().__init__("\n".join(rejected.problems))


class RequestMistaken(RemoteError):
    """A component found a mistake in the request, and did nothing: it has to be another request."""


def client_name() -> str:
    """The name of this client, user@host, which is recorded with a task. It is not an address: replies arrive on the connection."""
    return client_address(user_of_process())


class Client:
    """Sends requests to the components of a running system, and returns their replies.

    `post`: sends a message within a number of seconds, and returns the answer; by default by HTTP. `name`: that of the client; by default
    the user's.
    """

    def __init__(self, addresses: Addresses, post: Post | None = None, name: str | None = None) -> None:
        self.addresses = addresses
        self._own_wire = Wire(credentials_for(addresses))
        self._post = post if post is not None else self._own_wire.post
        self._client_name = client_address(name) if name is not None else client_name()
        self.task_managers = TaskManagers(addresses.task_managers, self.ask)

    async def __aenter__(self) -> Client:
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self._own_wire.close()

    async def ask(
        self,
        address: str,
        body: Body,
        expected: type[Answer],
        timeout: float = 30.0,
        patience: float = 0.0,
        id: str | None = None,
        author: str | None = None,
    ) -> Answer:
        """Send a request, and return the reply, which is of the expected type.

        `timeout`: seconds to wait for the reply. `patience`: seconds for which the message is sent again while there is no reply; the
        component processes messages with the same `id` once. `author`: the author of the request, if not the user of this program.

        Raises:
            RemoteError: there was no reply, or one of another type.
            RequestMistaken: the component found a mistake in the request.
            Refused: the Repository rejected the change.
        """
        header = Header(
            sender=client_address(author) if author else self._client_name, recipient=address, message_id=id or uuid.uuid4().urn
        )
        message = Message(header=header, body=body)
        try:
            answer = await retry_unanswered(lambda: self._post(message, timeout), patience)
        except Unanswered as error:
            raise Unanswered(f"{error}; `somrs status` shows what answers; try again") from None
        if answer is None:
            raise RemoteError(f"{address} took the {type(body).__name__} without an answer")
        if isinstance(answer.body, expected):
            return answer.body
        if isinstance(answer.body, frp.Fault):
            raise (RequestMistaken if answer.body.is_of_sender else RemoteError)(answer.body.text)
        if isinstance(answer.body, knowledge.Rejected):
            raise Refused(answer.body)
        raise RemoteError(f"{address} answered {type(body).__name__} with {type(answer.body).__name__}")

    # The Repository

    async def ontology(self, version: int | None = None) -> Ontology:
        """The ontology as it is now, or as it was at the version. Read again if it changes between two pages."""
        while True:
            definitions: list[Definition] = []
            changed: set[int] = set()
            offset, has_next_page = 0, True
            while has_next_page:
                question = knowledge.ReadOntology(after=offset, at_version=version)
                page = await self.ask(self.addresses.repository, question, knowledge.OntologyPage, timeout=READ_TIME)
                definitions += page.definitions.all_definitions()
                changed.add(page.changed_at)
                offset, has_next_page = page.next, page.more
            if len(changed) <= 1:
                return Ontology(definitions)

    async def map(self, version: int | None = None) -> Map:
        """The whole map as it is now, or as it was at the version. Read again if it changes between two pages."""
        while True:
            objects: list[Object] = []
            facts: list[Fact] = []
            versions: set[int] = set()
            name, last_object, has_next_page = "", "", True
            while has_next_page:
                question = knowledge.ReadMap(after=last_object, at_version=version)
                page = await self.ask(self.addresses.repository, question, knowledge.MapPage, timeout=READ_TIME)
                objects += page.objects
                facts += page.facts
                versions.add(page.version)
                name = page.map
                last_object, has_next_page = (page.objects[-1].name if page.objects else last_object), page.more
            if len(versions) <= 1:
                return Map(objects, facts, name)

    async def query(self, formula: str, limit: int = 100) -> knowledge.Rows:
        return await self.ask(self.addresses.repository, knowledge.QueryMap(formula=formula, limit=limit), knowledge.Rows)

    async def update(self, update: knowledge.UpdateMap) -> int:
        """Update the map, and return its new version."""
        return (await self.report(update)).version

    async def report(self, update: knowledge.UpdateMap) -> knowledge.Updated:
        """Update the map, and return its new version and what became of the report, such as the names of sighted objects."""
        return await self.ask(self.addresses.repository, update, knowledge.Updated)

    async def define(self, define: knowledge.Define) -> int:
        """Change the ontology, and return its new version."""
        return (await self.ask(self.addresses.repository, define, knowledge.Defined)).version

    async def rename(self, rename: knowledge.RenameObject) -> int:
        """Rename an object, and return the new version of the map."""
        return (await self.ask(self.addresses.repository, rename, knowledge.Updated)).version

    async def merge(self, merge: knowledge.MergeObject) -> int:
        """State that an object is another one, and return the new version of the map."""
        return (await self.ask(self.addresses.repository, merge, knowledge.Updated)).version

    async def undo(self, version: int, author: str = "") -> int:
        """Undo the changes of a version, and return the new version."""
        return (await self.ask(self.addresses.repository, knowledge.Undo(version=version, author=author), knowledge.Updated)).version

    async def consider(self, change: knowledge.Alteration) -> knowledge.Considered:
        """The consequences of a change, without making it."""
        return await self.ask(self.addresses.repository, knowledge.Consider(change=change), knowledge.Considered)

    async def read_events(self, request: knowledge.ReadEvents) -> knowledge.Events:
        """Up to `request.limit` events of the map and the ontology, read page by page."""
        events: list[knowledge.Event] = []
        while True:
            page = await self.ask(self.addresses.repository, request, knowledge.Events, timeout=READ_TIME)
            events += page.events
            remaining_count = request.limit - len(page.events)
            if remaining_count <= 0 or not page.more or not page.events:
                return knowledge.Events(events=tuple(events), more=page.more, since=page.since)
            further = {"before" if request.after is None else "after": page.events[-1].version}
            request = msgspec.structs.replace(request, limit=remaining_count, **further)

    async def history(self, name: str, limit: int = 100, before: int | None = None) -> knowledge.History:
        """Up to `limit` events of an object, newest first, from before the version `before`, read page by page."""
        events: list[knowledge.Event] = []
        while True:
            question = knowledge.ReadHistory(object=name, limit=limit - len(events), before=before)
            page = await self.ask(self.addresses.repository, question, knowledge.History, timeout=READ_TIME)
            events += page.events
            if len(events) >= limit or not page.more or not page.events:
                return msgspec.structs.replace(page, events=tuple(events))
            before = page.events[-1].version

    # The Service Registry

    async def services(self, request: directory.Discover | None = None) -> tuple[directory.Offer, ...]:
        return tuple([offer async for page in self._discover(request or directory.Discover()) for offer in page.offers])

    async def withheld_services(self, request: directory.Discover | None = None) -> list[tuple[directory.Offer, str]]:
        """The matching services that are published and not listed, with the reasons."""
        question = msgspec.structs.replace(request or directory.Discover(), withheld=True)
        pages = [page async for page in self._discover(question)]
        reasons = {(entry.service, entry.registry): entry.reason for page in pages for entry in page.withheld}
        return [(offer, reasons.get((offer.service, offer.registry), "")) for page in pages for offer in page.offers]

    async def neighbours(self) -> tuple[directory.NeighbourView, ...]:
        """The neighbours whose offers the Registry lists with its own."""
        return (await self.ask_registry(directory.Discover(provider=NOBODY), directory.Discovered)).neighbours

    async def ask_registry(self, question: Body, expected: type[Answer]) -> Answer:
        """Ask the Registry, or another one of the system if it does not answer: they list the same."""
        return await first_answer(
            [*self.addresses.registries.values()], lambda address: self.ask(address, question, expected, timeout=READ_TIME)
        )

    async def map_neighbours(self) -> Neighbours:
        """The name of the map, and the neighbours whose objects it has."""
        return await self.ask(self.addresses.repository, ReadNeighbours(), Neighbours)

    async def _discover(self, question: directory.Discover) -> AsyncIterator[directory.Discovered]:
        while True:
            page = await self.ask_registry(question, directory.Discovered)
            yield page
            if not page.more:
                return
            question = msgspec.structs.replace(question, after=page.offers[-1].service)

    async def presence(self) -> tuple[directory.PresenceChange, ...]:
        """The latest arrivals and departures of devices, newest first."""
        return (await self.ask_registry(directory.ReadPresence(), directory.PresenceLog)).changes

    # The Task Managers

    async def submit(
        self,
        task: submission.Submit,
        patience: float = 0.0,
        id: str | None = None,
        author: str | None = None,
        task_manager: str | None = None,
    ) -> str:
        """Submit a task, and return its id. Submissions with the same message `id` are one task. With several Task Managers, any takes it,
        or that with the name `task_manager`.

        Raises:
            FormulaError: there is a mistake in a formula of the task.
            UsageError: something else about the task is invalid, or no Task Manager has this name.
            RemoteError: no Task Manager accepted the task.
        """
        answer = await self.task_managers.submit(task, patience, id, author, task_manager)
        match answer:
            case submission.Submitted(task=id) | reservations.TaskAssigned(task=id):
                return id
            case submission.TaskRejected(mistake=submission.FormulaMistake() as mistake):
                raise FormulaError(mistake.text, mistake.position, mistake.problem, mistake.hint)
            case submission.TaskRejected(problem=wrong):
                raise UsageError(wrong)
            case frp.Fault(text=text):
                raise RemoteError(text)
            case _:
                raise RemoteError(f"the Task Manager answered {type(answer).__name__}")

    async def news(self, task: str) -> AsyncIterator[task_news.TaskNews]:
        """Yield the news of the task until it has ended, across restarts of the Task Manager."""
        event_count = 0
        while True:
            watch = task_news.WatchTask(task=task, after=event_count)
            news = await self.watch(watch, patience=PATIENCE)
            yield news
            if news.view.phase is task_views.Phase.ENDED and not news.more:
                return
            event_count += len(news.events)

    async def watch(self, request: task_news.WatchTask, patience: float = 0.0) -> task_news.TaskNews:
        """News of a task. A view that is too long for one message is read in parts and joined."""
        parts: list[task_views.TaskView] = []
        name = await self.task_managers.name_of(request.task, patience)
        address = self.task_managers.addresses[name]
        news = await self.ask(address, request, task_news.TaskNews, timeout=_answer_time(request.wait), patience=patience)
        while news.rest is not None:
            parts.append(news.view)
            next_request = msgspec.structs.replace(request, parts=news.rest, wait=0)
            news = await self.ask(address, next_request, task_news.TaskNews, timeout=READ_TIME, patience=patience)
        views = [*parts, news.view]
        steps, work = (tuple(chain.from_iterable(getattr(view, part) for view in views)) for part in ("steps", "work"))
        view = msgspec.structs.replace(news.view, steps=steps, work=work, task_manager=self.task_managers.label(name))
        return msgspec.structs.replace(news, view=view)

    async def watch_list(self, request: task_news.WatchTasks, task_manager: str) -> task_news.TasksNews:
        """A page of the changes in the list of tasks of the Task Manager with this name."""
        address = self.task_managers.addresses[task_manager]
        news = await self.ask(address, request, task_news.TasksNews, timeout=_answer_time(request.wait))
        return msgspec.structs.replace(news, rows=tuple(self._of_manager(row, task_manager) for row in news.rows))

    async def rows(self) -> Listing[task_views.TaskRow]:
        """The tasks that the Task Managers hold, as rows of a list, newest first."""
        return _newest_first(await self.task_managers.ask_all(self._rows))

    async def _rows(self, name: str) -> tuple[task_views.TaskRow, ...]:
        rows_by_task: dict[str, task_views.TaskRow] = {}
        version, has_next_page = 0, True
        while has_next_page:
            news = await self.watch_list(task_news.WatchTasks(after=version, wait=0), name)
            rows_by_task |= {row.task: row for row in news.rows}
            version, has_next_page = news.version, news.more
        return tuple(rows_by_task.values())

    def _of_manager(self, task: Shown, name: str) -> Shown:
        """The task as one of the Task Manager with this name, which is remembered."""
        self.task_managers.remember(task.task, name)
        return msgspec.structs.replace(task, task_manager=name) if self.task_managers.several else task

    async def read_task(self, task: str) -> task_news.TaskNews:
        """The task as it is now, with all its events and, while it runs, all its contracts."""
        events: tuple[task_views.TaskEvent, ...] = ()
        contracts: dict[str, task_views.ContractView] = {}
        changed, has_next_page = 0, True
        while has_next_page:
            news = await self.watch(task_news.WatchTask(task=task, after=len(events), contracts=changed, wait=0))
            events += news.events
            contracts |= {contract.participant: contract for contract in news.contracts}
            changed, has_next_page = news.contracts_at, news.more
        sorted_contracts = sorted(contracts.values(), key=lambda contract: contract.number)
        return msgspec.structs.replace(news, events=events, contracts=tuple(sorted_contracts))

    async def all_messages(self, task: str) -> tuple[task_views.MessageView, ...]:
        """All messages of a running or ended task."""
        messages: tuple[task_views.MessageView, ...] = ()
        has_next_page = True
        while has_next_page:
            page = await self.messages(task, len(messages))
            messages, has_next_page = messages + page.messages, page.more
        return messages

    async def tasks(self, *, running: bool = False, limit: int | None = None) -> Listing[task_views.TaskView]:
        """The tasks that the Task Managers hold, newest first: all, or those that have not ended."""
        listing = _newest_first(await self.task_managers.ask_all(lambda name: self._tasks(name, running, limit)))
        return msgspec.structs.replace(listing, items=listing.items[:limit])

    async def _tasks(self, name: str, running: bool, limit: int | None) -> tuple[task_views.TaskView, ...]:
        tasks: list[task_views.TaskView] = []
        question = task_news.ReadTasks(running=running, limit=PAGE if limit is None else min(limit, PAGE))
        while limit is None or len(tasks) < limit:
            page = await self.ask(self.task_managers.addresses[name], question, task_news.Tasks, timeout=READ_TIME)
            tasks += (self._of_manager(task, name) for task in page.tasks)
            if not page.more:
                break
            question = msgspec.structs.replace(question, behind=page.tasks[-1].task)
        return tuple(tasks[:limit])

    async def records(self, query: records.ReadRecords) -> records.Records:
        """A page of the records of ended tasks."""
        return await self.task_managers.records(query)

    async def cancel(self, task: str, reason: str) -> None:
        request = submission.CancelTask(task=task, reason=reason)
        address = await self.task_managers.address_of(task, PATIENCE)
        await self.ask(address, request, submission.Cancelling, patience=PATIENCE)

    async def pause(self, task: str, author: str, *, paused: bool = True) -> bool:
        """Pause a task, or let it go on. Returns whether it is paused now."""
        request = submission.PauseTask(task=task, resume=not paused, author=author)
        address = await self.task_managers.address_of(task, PATIENCE)
        return (await self.ask(address, request, submission.TaskPaused, patience=PATIENCE)).paused

    async def messages(self, task: str, offset: int = 0) -> task_news.Messages:
        """A page of the messages of a running or ended task, after the first `offset`."""
        address = await self.task_managers.address_of(task)
        return await self.ask(address, task_news.ReadMessages(task=task, after=offset), task_news.Messages, timeout=READ_TIME)

    async def preview(self, request: previews.Preview) -> previews.Previewed:
        return await self.task_managers.ask_any(request, previews.Previewed, timeout=60)


def _answer_time(wait: float) -> float:
    """Seconds within which a request is answered that waits so long for news. One that waits is asked again, and may take its time."""
    return wait + 40 if wait else READ_TIME


def _newest_first(answers: Answers[tuple[Shown, ...]]) -> Listing[Shown]:
    tasks = sorted(chain.from_iterable(answers.by_name.values()), key=lambda task: (task.submitted_at, task.task), reverse=True)
    return Listing(items=tuple(tasks), silent=answers.silent)

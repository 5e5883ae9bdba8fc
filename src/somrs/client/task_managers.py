"""The Task Managers of a system, as clients see them: one list of tasks, and any of them takes a task.

With a single Task Manager, each request goes to it. With several, what concerns one task goes to the Task Manager that has it, and lists
are joined. One that does not answer is named, and the others' tasks are listed.
"""

from __future__ import annotations

import asyncio
import uuid
from collections.abc import Awaitable, Callable, Iterator, Mapping
from functools import partial
from typing import Generic, Protocol, TypeVar

from msgspec import Struct, structs

from somrs.client.joined_records import join_records, of_task_manager
from somrs.errors import RemoteError, UsageError
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import message_id
from somrs.protocol.messages.records import ReadRecords, Records
from somrs.protocol.messages.reservations import TaskAssigned
from somrs.protocol.messages.submission import Submit, SubmitOnce
from somrs.protocol.messages.task_news import Messages, ReadMessages, ReadTasks, Tasks
from somrs.runtime.wire import Unanswered, retry_unanswered

T = TypeVar("T")
Answer = TypeVar("Answer")

READ_TIME = 10.0
"""Seconds after which a reader is told that a component does not answer now. Nothing else depends on that."""

ANSWER_TIME = 5.0
"""Seconds that one of several Task Managers has to answer before it is said that it does not. Nothing else depends on that."""

PROBE_TIME = 2.0
"""Seconds that it has to answer before a new task is first stated at others."""

MOST_KNOWN = 10_000
"""The number of tasks of which a client remembers whose they are."""

ALL_MESSAGES = 10**9
"""A number of messages greater than any task has."""


class Ask(Protocol):
    """Sends a request to an address, as `Client.ask` does."""

    async def __call__(
        self,
        address: str,
        body: Body,
        expected: type[Answer],
        timeout: float = 30.0,
        patience: float = 0.0,
        id: str | None = None,
        author: str | None = None,
    ) -> Answer: ...


class Listing(Struct, Generic[T], frozen=True, kw_only=True):
    """What all Task Managers together have. `silent`: the names of those that did not answer; what they have is missing."""

    items: tuple[T, ...]
    silent: tuple[str, ...] = ()

    def __iter__(self) -> Iterator[T]:
        return iter(self.items)

    def __len__(self) -> int:
        return len(self.items)


class Answers(Struct, Generic[T], frozen=True, kw_only=True):
    """The answers of all Task Managers by name, and the names of those that did not answer."""

    by_name: dict[str, T]
    silent: tuple[str, ...] = ()


def silent_text(silent: tuple[str, ...]) -> str:
    """The sentence, for people, that Task Managers do not answer; empty if all do."""
    if not silent:
        return ""
    return f"{' and '.join(silent)} {'does' if len(silent) == 1 else 'do'} not answer; tasks there are missing from the list"


class TaskManagers:
    """Asks the Task Managers with these addresses, given by name."""

    def __init__(self, addresses: Mapping[str, str], ask: Ask) -> None:
        self.addresses, self._ask = addresses, ask
        self._names: dict[str, str] = {}
        """The names of the Task Managers that have these tasks, as far as this client knows, oldest first."""

    @property
    def several(self) -> bool:
        return len(self.addresses) > 1

    def label(self, name: str) -> str:
        """How a Task Manager is named in lists: not at all if it is the only one."""
        return name if self.several else ""

    def remember(self, task: str, name: str) -> None:
        """Note which Task Manager has the task."""
        if self.several:
            self._names[task] = name
            while len(self._names) > MOST_KNOWN:
                del self._names[next(iter(self._names))]

    async def ask_all(self, ask_one: Callable[[str], Awaitable[T]], time: float = ANSWER_TIME) -> Answers[T]:
        """Call `ask_one` with each name. Raises RemoteError if none answers, or for an answer that is an error."""
        if not self.several:
            return Answers(by_name={name: await ask_one(name) for name in self.addresses})
        results = await asyncio.gather(*(_within(time, ask_one(name)) for name in self.addresses))
        answers = dict(zip(self.addresses, results, strict=True))
        silent = tuple(name for name, result in answers.items() if isinstance(result, Unanswered))
        if len(silent) == len(answers):
            raise next(result for result in results if isinstance(result, Unanswered))
        return Answers(by_name={name: result for name, result in answers.items() if not isinstance(result, Unanswered)}, silent=silent)

    async def records(self, query: ReadRecords) -> Records:
        """A page of the records of ended tasks."""
        silent: dict[str, None] = {}

        async def read_pages(query: ReadRecords) -> list[Records]:
            answers = await self.ask_all(lambda name: self._ask(self.addresses[name], query, Records, timeout=READ_TIME))
            silent.update(dict.fromkeys(answers.silent))
            return [of_task_manager(page, self.label(name)) for name, page in answers.by_name.items()]

        if not self.several or query.task in self._names:
            name = await self.name_of(query.task or "")
            return of_task_manager(await self._ask(self.addresses[name], query, Records, timeout=READ_TIME), self.label(name))
        return structs.replace(await join_records(query, read_pages), silent=tuple(silent))

    # One task

    async def name_of(self, task: str, patience: float = 0.0) -> str:
        """The name of the Task Manager that has the task, or its record.

        Raises:
            Unanswered: those that answer do not have it; another one does not answer.
            RemoteError: none has it.
        """
        if not self.several:
            return next(iter(self.addresses))
        if task not in self._names:
            self.remember(task, await self._find(task, patience))
        return self._names[task]

    async def address_of(self, task: str, patience: float = 0.0) -> str:
        """The address of that Task Manager."""
        return self.addresses[await self.name_of(task, patience)]

    async def _find(self, task: str, patience: float) -> str:
        query = ReadMessages(task=task, after=ALL_MESSAGES)
        asked = {
            asyncio.ensure_future(self._ask(address, query, Messages, timeout=ANSWER_TIME, patience=patience)): name
            for name, address in self.addresses.items()
        }
        silent: list[str] = []
        try:
            for answer in asyncio.as_completed(asked):
                try:
                    await answer
                except RemoteError:
                    continue
                break
            for future, name in asked.items():
                if future.done() and future.exception() is None:
                    return name
                if future.done() and isinstance(future.exception(), Unanswered):
                    silent.append(name)
        finally:
            for future in asked:
                future.cancel()
        if silent:
            raise Unanswered(f"{' and '.join(silent)} {'does' if len(silent) == 1 else 'do'} not answer, and no other has task {task}")
        raise RemoteError(f"there is no task {task} here")

    # Any one

    async def submit(self, task: Submit, patience: float, id: str | None, author: str | None, name: str | None = None) -> object:
        """State a task at the Task Manager with this name; by default, at the one with the fewest open tasks, or at another one if that
        does not answer. Returns the answer.

        They agree whose it is, so that it is one task even if several have received it. Raises UsageError if none has this name.
        """
        if name is not None and name not in self.addresses:
            raise UsageError(f"there is no Task Manager {name} here; there is {', '.join(self.addresses)}")
        if not self.several:
            return await self._ask(next(iter(self.addresses.values())), task, object, patience=patience, id=id, author=author)
        id = id or uuid.uuid4().urn
        addresses = await self._by_load(id) if name is None else [self.addresses[name]]
        ask_one = partial(self._ask, body=SubmitOnce(submission=task), expected=object, id=id, author=author)
        answer = await retry_unanswered(lambda: first_answer(addresses, ask_one), patience)
        if isinstance(answer, TaskAssigned):
            names = (name for name, address in self.addresses.items() if address == answer.task_manager)
            self.remember(answer.task, next(names, ""))
        return answer

    async def ask_any(self, request: Body, expected: type[Answer], timeout: float) -> Answer:
        """Ask the Task Manager with the fewest open tasks, or another one if that does not answer. The request changes nothing."""
        addresses = await self._by_load(uuid.uuid4().urn) if self.several else [*self.addresses.values()]
        return await first_answer(addresses, lambda address: self._ask(address, request, expected, timeout=timeout))

    async def _by_load(self, id: str) -> list[str]:
        """The addresses, those with few open tasks first, and at last those that do not answer."""
        query = ReadTasks(limit=0, running=True)
        try:
            answers = await self.ask_all(lambda name: self._ask(self.addresses[name], query, Tasks), PROBE_TIME)
            loads = {name: page.total or 0 for name, page in answers.by_name.items()}
        except Unanswered:
            loads = {}
        names = sorted(self.addresses, key=lambda name: (name not in loads, loads.get(name, 0), message_id(id, name)))
        return [self.addresses[name] for name in names]


async def _within(time: float, asking: Awaitable[T]) -> T | Unanswered:
    """The answer, or the reason why there is none within this time."""
    try:
        async with asyncio.timeout(time):
            return await asking
    except TimeoutError:
        return Unanswered(f"there was no answer within {time:g} s")
    except Unanswered as error:
        return error


async def first_answer(addresses: list[str], ask_one: Callable[[str], Awaitable[T]]) -> T:
    """The answer of the first of the addresses that answers. Raises Unanswered if none does."""
    for address in addresses[:-1]:
        try:
            return await ask_one(address)
        except Unanswered:
            continue
    return await ask_one(addresses[-1])

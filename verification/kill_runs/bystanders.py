"""Clients that work with the system while a run is on: they change the map and submit tasks, and note what was acknowledged."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field

from somrs.client.client import Client
from somrs.ontology.objects import ValueSet
from somrs.protocol.messages.clients import Submit
from somrs.protocol.messages.knowledge import Updated, UpdateMap

PAUSE = 0.3
"""Seconds between two inputs of a client."""
PATIENCE = 60.0
"""Seconds for which an input is sent again."""
CHANGED, PATH = "Room002", "Label"
"""What is changed again and again; nothing that a task is about."""
SATISFIED_GOAL = "Door001.Open = TRUE"
"""A wish without steps."""
AUTHOR = "bystander"


@dataclass(slots=True)
class Acknowledged:
    """What the bystanders were told is taken."""

    versions: dict[str, int] = field(default_factory=dict)
    """Of the map, by the label that was set in it."""
    tasks: list[str] = field(default_factory=list)


class Bystanders:
    """`burst` has some more tasks submitted, all at once: just when somebody is killed."""

    def __init__(self, client: Client, name: str) -> None:
        self.acknowledged = Acknowledged()
        self._client, self._name = client, name
        self._number = 0
        self._finished = asyncio.Event()
        self._bursts: list[asyncio.Task[None]] = []

    @contextlib.asynccontextmanager
    async def at_work(self) -> AsyncIterator[Bystanders]:
        """While the context lasts they work; at its end all that they have begun is acknowledged, or it raises RemoteError."""
        working = [asyncio.create_task(self._repeat(work)) for work in (self._update, self._submit)]
        try:
            yield self
            self._finished.set()
            await asyncio.gather(*working, *self._bursts)
        finally:
            for task in [*working, *self._bursts]:
                task.cancel()

    def burst(self) -> None:
        self._bursts += [asyncio.create_task(work()) for work in (self._submit, self._submit, self._submit, self._update)]

    async def _repeat(self, work: Callable[[], Awaitable[None]]) -> None:
        while not self._finished.is_set():
            await work()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._finished.wait(), PAUSE)

    async def _update(self) -> None:
        self._number += 1
        label = f"{self._name}, {self._number}"
        update = UpdateMap(changes=(ValueSet(CHANGED, PATH, label),), author=AUTHOR)
        answer = await self._client.ask(self._client.addresses.repository, update, Updated, patience=PATIENCE)
        self.acknowledged.versions[label] = answer.version

    async def _submit(self) -> None:
        self.acknowledged.tasks.append(await self._client.submit(Submit(effect=SATISFIED_GOAL), patience=PATIENCE))

"""Clients that use the system during a run: they change the map, submit tasks, and record the acknowledgements."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field

from somrs.client.client import Client
from somrs.ontology.objects import ValueSet
from somrs.protocol.messages.knowledge import Updated, UpdateMap
from somrs.protocol.messages.submission import Submit

PAUSE = 0.3
"""Seconds between two requests of a client."""
PATIENCE = 60.0
"""Seconds for which a request is repeated."""
CHANGED, PATH = "Room002", "Label"
"""The attribute that is changed; no task depends on it."""
SATISFIED_GOAL = "Door001.Open = TRUE"
"""A goal that holds, so that its plan has no steps."""
AUTHOR = "bystander"


@dataclass(slots=True)
class Acknowledged:
    """The acknowledged inputs."""

    versions: dict[str, int] = field(default_factory=dict)
    """Versions of the map, by the label that was set in them."""
    tasks: list[str] = field(default_factory=list)


class Bystanders:
    """The clients. `burst` submits several inputs at once, at the moment of the kill."""

    def __init__(self, client: Client, name: str) -> None:
        self.acknowledged = Acknowledged()
        self._client, self._name = client, name
        self._number = 0
        self._finished = asyncio.Event()
        self._bursts: list[asyncio.Task[None]] = []

    @contextlib.asynccontextmanager
    async def at_work(self) -> AsyncIterator[Bystanders]:
        """A context in which the clients work. At its end all their inputs are acknowledged, or it raises RemoteError."""
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
                async with asyncio.timeout(PAUSE):
                    await self._finished.wait()

    async def _update(self) -> None:
        self._number += 1
        label = f"{self._name}, {self._number}"
        update = UpdateMap(changes=(ValueSet(CHANGED, PATH, label),), author=AUTHOR)
        answer = await self._client.ask(self._client.addresses.repository, update, Updated, patience=PATIENCE)
        self.acknowledged.versions[label] = answer.version

    async def _submit(self) -> None:
        self.acknowledged.tasks.append(await self._client.submit(Submit(effect=SATISFIED_GOAL), patience=PATIENCE))

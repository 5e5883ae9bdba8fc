"""The map as the devices of one process share it: they read a copy instead of asking the Repository each time.

What a device reads is never older than what the Repository had when the device asked: before an answer, the copy waits for the Repository's
current version. One question for this version serves all who ask meanwhile.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from somrs.errors import InputError, RemoteError
from somrs.kernel.component import Effect, Input, Received, Started
from somrs.kernel.not_understood import refuse_request
from somrs.kernel.replica import Replica
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import MapPage, QueryMap, ReadMap
from somrs.repository.map_answers import MapAnswers
from somrs.repository.state import LargeQuery
from somrs.runtime.host import Host

MAPS = "/maps"
"""The path above those of all copies."""
LAST_NAME = "\ufffd"
"""A name after those of all objects: the page that begins there has the version alone."""
PATIENCE = 60.0
"""Seconds for which an answer waits for news of changes that the Repository has made."""

Request = Callable[[Body], Awaitable[Body]]
"""Sends a request to the Repository and returns the answer."""


class _Copy:
    """The component that keeps the copy, and notes when it is renewed."""

    def __init__(self, address: str, repository: str) -> None:
        self.replica = Replica(address, repository)
        self.renewed = asyncio.Event()

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Started):
            return self.replica.start(now)
        news = self.replica.handle(event, now)
        self.renewed.set()
        if news is None:
            return [*refuse_request(event.message, "devices read a map here")] if isinstance(event, Received) else []
        return news.effects


class SharedMap:
    """A copy of the map at a host, from which devices are answered. `path`: that of the copy; `request`: asks the Repository."""

    def __init__(self, host: Host, path: str, repository: str, request: Request) -> None:
        self._copy = _Copy(f"{host.url}{path}", repository)
        self._answers, self._request = MapAnswers(), request
        self._open_probe: asyncio.Task[int] | None = None
        """The question for the current version that is on its way."""
        self._queued_probe: asyncio.Task[int] | None = None
        """The question that is sent after it."""
        host.add(path, lambda _: self._copy)

    async def whole(self, *, is_current: bool = True) -> tuple[Map, Ontology]:
        """The map and the ontology as they are now; if it need not be `is_current`, as they were when the last news came. Raises
        RemoteError."""
        replica = self._copy.replica
        version = await self._current_version() if is_current else 0
        while not replica.ready or replica.version < version:
            self._copy.renewed.clear()
            await self._copy.renewed.wait()
        return replica.map, replica.ontology

    async def answer(self, question: QueryMap | ReadMap) -> Body:
        """The answer to a question about the map as it is now. Raises RemoteError."""
        replica = self._copy.replica
        if not replica.ready or (isinstance(question, ReadMap) and question.at_version is not None):
            return await self._request(question)
        version = await self._current_version()
        try:
            async with asyncio.timeout(PATIENCE):
                while replica.version < version:
                    self._copy.renewed.clear()
                    await self._copy.renewed.wait()
        except TimeoutError:
            return await self._request(question)
        try:
            answer = self._answers.answer(question, replica.map, replica.ontology, replica.version)
        except InputError as error:
            return Fault(code="Sender", text=str(error))
        return answer if not isinstance(answer, LargeQuery) else await self._request(question)

    async def _current_version(self) -> int:
        """The Repository's version, which is asked for after this call: an answer that is on its way may be older than the question."""
        if self._queued_probe is None:
            self._queued_probe = asyncio.create_task(self._ask_after(self._open_probe))
            self._queued_probe.add_done_callback(
                lambda question: question.cancelled() or question.exception()
            )  # nobody may wait for it any more
        return await asyncio.shield(self._queued_probe)

    async def _ask_after(self, open_probe: asyncio.Task[int] | None) -> int:
        if open_probe is not None:
            await asyncio.wait([open_probe])
        self._open_probe, self._queued_probe = self._queued_probe, None
        page = await self._request(ReadMap(after=LAST_NAME))
        match page:
            case MapPage(version=version):
                return version
            case Fault(text=text):
                raise RemoteError(text)
        raise RemoteError(f"the Repository answered ReadMap with {type(page).__name__}")

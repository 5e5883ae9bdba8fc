"""The journal with which a program continues its component: on its own, or on a bus, as leader or as standby.

On a bus, several processes on different hosts may run the same component. One of them leads. The others follow its journal and have the
same state, and when it ends, one of them goes on as the same component, at the same address.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import uuid
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any

from somrs.deployment.programs import say_ready, stop_signals, until_stopped
from somrs.errors import RemoteError, UsageError
from somrs.kernel.component import Stateful
from somrs.kernel.durability import JournaledComponent
from somrs.runtime.bus_address import BusAddress
from somrs.runtime.host import Host
from somrs.runtime.node import CarryOut, Node, refuse_work
from somrs.storage.journal import Journal, Log
from somrs.storage.lease import RENEWAL
from somrs.storage.stream_log import StreamLog

COPY_AFTER = 20_000
"""The number of batches after which the leader stores a copy of its file, and deletes them from the stream."""

KEPT = 1000
"""The number of batches before a copy that stay in the stream, for standbys that are a little behind."""

OpenJournal = Callable[[Log | None], Journal]
"""Opens the journal of a component, in its file, with this log."""

IDENTITY_FILE = "identity"
"""The file in the data folder with the name by which leases on a bus know it."""


class Continuation:
    """The continuation of a component from its `journal`. `add` returns when this process is the one to do it."""

    def __init__(self, journal: Journal, stream: StreamLog | None) -> None:
        self.journal, self._stream = journal, stream
        self._lost = asyncio.Event()
        if stream is not None:
            stream.on_lost = partial(asyncio.get_running_loop().call_soon_threadsafe, self._lost.set)
        self._copied_to = 0
        """The place up to which a copy of the file has the entries."""

    async def add(
        self,
        runtime: Host,
        path: str,
        factory: Callable[[str], Stateful],
        *,
        carry_out: CarryOut = refuse_work,
        notices: Sequence[object] = (),
    ) -> Node:
        """Add the component to the runtime, as `Host.add_journaled`. On a bus, first follow the one that leads, as long as there is one."""
        if self._stream is None:
            return runtime.add_journaled(path, factory, self.journal, carry_out=carry_out, notices=notices, recovers=True)
        journaled, is_resumed = await self._lead(self._stream, f"{runtime.url}{path}", factory)
        node = runtime.add_continued(path, journaled, self.journal, is_resumed=is_resumed, carry_out=carry_out, notices=notices)
        await runtime.listening()
        return node

    async def serve(self, name: str, node: Node) -> None:
        """Run until this process is asked to stop. Raises UsageError when another process continues the component."""
        waiting: list[asyncio.Future[Any]] = [asyncio.ensure_future(until_stopped(name, node.address))]
        if self._stream is not None:
            waiting += map(asyncio.ensure_future, (self._lost.wait(), node.broken.wait(), self._copy_at_times(self._stream)))
        try:
            await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in waiting:
                task.cancel()
        if not waiting[0].done() or waiting[0].cancelled():
            failures = [str(task.exception()) for task in waiting if task.done() and not task.cancelled() and task.exception()]
            reason = self.journal.disk.failed or ", ".join(failures) or f"another process continues the component at {node.address}"
            raise UsageError(f"{name} ends: {reason}")

    async def _lead(self, stream: StreamLog, address: str, factory: Callable[[str], Stateful]) -> tuple[JournaledComponent, bool]:
        """Follow the journal until this process leads. Returns the component, and whether there was one."""
        parent, is_said = os.getppid(), False
        journaled, is_resumed = self.journal.begin(address, factory)
        # What was said to a component at another address cannot be handled again at this one: it would do its tasks once more.
        copied_address = await stream.copied_address()
        begins_anew = not is_resumed and copied_address not in (None, address)
        stream.last = (await stream.bounds())[1] if begins_anew else await stream.place_after(journaled.number) - 1
        with stop_signals() as signals:
            while not await stream.acquire():
                await self._follow(stream, journaled)
                if not is_said:
                    say_ready(stream.component, f"{address} (standby)")
                    is_said = True
                await stream.wait_for_news(RENEWAL)
                if not signals.empty():
                    raise SystemExit(0)
                if os.getppid() != parent:
                    raise RemoteError(f"{stream.component} ends, because the process that started it has ended")
        has_all = False
        while not has_all:
            number_on_bus = await self._follow(stream, journaled)
            has_all = await stream.begin_writing(journaled.number)
        if copied_address != address or await stream.copied_number() is None or number_on_bus < journaled.number:
            await self._copy(stream)
        return journaled, is_resumed or journaled.number > 0

    async def _follow(self, stream: StreamLog, journaled: JournaledComponent) -> int:
        """Handle the entries on the bus that are new here. Returns the number of the last entry on the bus.

        Raises UsageError when they cannot be stored here: who cannot store cannot lead.
        """
        if self.journal.disk.failed is not None:
            raise UsageError(f"{stream.component} ends: {self.journal.disk.failed}")
        number = 0
        if stream.last:
            last_batch = await stream.batch(stream.last)
            number = last_batch.number if last_batch is not None else await stream.copied_number() or 0
        while (batch := await stream.batch(stream.last + 1)) is not None:
            if batch.document:
                self.journal.follow(journaled, batch.document, batch.version)
            stream.last, number = batch.sequence, batch.number
            stream.number = journaled.number
            if self.journal.due:
                self.journal.snapshot(journaled)
        if (await stream.bounds())[0] > stream.last + 1:
            raise UsageError(
                f"{stream.component} ends: it was so far behind that only the copy on the bus has what it missed; start it again"
            )
        return number

    async def _copy_at_times(self, stream: StreamLog) -> None:
        """Store a copy of the file whenever the stream has become long."""
        self._copied_to = (await stream.bounds())[0] - 1
        while True:
            await asyncio.sleep(RENEWAL)
            if stream.last - self._copied_to >= COPY_AFTER:
                await self._copy(stream)

    async def _copy(self, stream: StreamLog) -> None:
        """Store a copy of the file on the bus, and delete the entries that it has from the stream."""
        await self.journal.disk.stored()
        place, number = stream.last, stream.number
        file = self.journal.disk.path.with_suffix(".copy")
        file.unlink(missing_ok=True)
        await asyncio.wrap_future(self.journal.disk.read(lambda db: db.execute("VACUUM INTO ?", (str(file),)) and None))
        await stream.store_copy(file, number, self.journal.address)
        file.unlink()
        self._copied_to = place
        await stream.forget_before(place - KEPT)


@asynccontextmanager
async def continuing(bus: BusAddress | None, component: str, file: Path, open_journal: OpenJournal) -> AsyncIterator[Continuation]:
    """Open the journal of a component in its file, with the copy that is on the bus if the file is not there or is behind it.

    Raises UsageError when the journal cannot be opened.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    stream = StreamLog(bus.servers, bus.site, component, _identity(file.parent)) if bus is not None else None
    try:
        if stream is not None:
            await stream.open()
        journal = await _opened(stream, file, open_journal)
        try:
            yield Continuation(journal, stream)
        finally:
            if stream is not None:
                stream.end_writing()
            journal.close()
            if stream is not None:
                await stream.resign()
    finally:
        if stream is not None:
            await stream.close()


async def _opened(stream: StreamLog | None, file: Path, open_journal: OpenJournal) -> Journal:
    while True:
        journal = open_journal(stream)
        if stream is None:
            return journal
        copied_number = await stream.copied_number()
        if copied_number is None:
            # Only the one that leads begins a new journal; the others wait for its copy.
            if not journal.is_new or await stream.acquire():
                return journal
        elif not journal.is_new and journal.number >= copied_number:
            return journal
        journal.close()
        if copied_number is None:
            await asyncio.sleep(RENEWAL)
            continue
        copy = file.with_suffix(".copy")
        await stream.fetch_copy(copy)
        for suffix in ("-wal", "-shm"):
            file.with_name(file.name + suffix).unlink(missing_ok=True)
        copy.replace(file)


def _identity(folder: Path) -> str:
    """The name by which the leases on a bus know a data folder: a process that is started again there has its lease at once."""
    file = folder / IDENTITY_FILE
    with contextlib.suppress(FileExistsError), file.open("x") as new_file:
        new_file.write(uuid.uuid4().hex)
    return file.read_text()

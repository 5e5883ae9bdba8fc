"""The journal with which a program continues its component: on its own, or on a bus, as leader or as standby.

On a bus, several processes on different hosts may run the same component. One of them leads. The others follow its journal and have the
same state, and when it ends, one of them goes on as the same component, at the same address.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import uuid
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any

from somrs.deployment.joining import JoinedJournal, OpenJournal, join, note_joined
from somrs.deployment.programs import parent_process, say_ready, stop_signals, until_stopped
from somrs.errors import RemoteError, UsageError
from somrs.kernel.component import Stateful
from somrs.kernel.durability import JournaledComponent
from somrs.runtime.bus_address import BusAddress
from somrs.runtime.host import Host
from somrs.runtime.node import CarryOut, Node, refuse_work
from somrs.storage.lease import RENEWAL
from somrs.storage.stored_copy import CopyInfo
from somrs.storage.stream_log import StreamLog

log = logging.getLogger(__name__)

COPY_AFTER = 20_000
"""The number of batches after which the leader stores a copy of its file, and deletes them from the stream."""

KEPT = 1000
"""The number of batches before a copy that stay in the stream, for standbys that are a little behind."""

IDENTITY_FILE = "identity"
"""The file in the data folder with the name by which leases on a bus know it."""


class Continuation:
    """The continuation of a component from a journal. `add` returns when this process is the one to do it."""

    def __init__(self, joined: JoinedJournal, stream: StreamLog | None) -> None:
        self.journal, self._joined, self._stream = joined.journal, joined, stream
        self._lost = asyncio.Event()
        if stream is not None:
            stream.on_lost = partial(asyncio.get_running_loop().call_soon_threadsafe, self._lost.set)
        self._copied_to = 0
        """The place up to which a copy of the file has the entries."""
        self._history, self._replaced = "", tuple[str, ...]()
        """The history on the bus with which this process goes on, and those that were given up for it."""

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
        journaled, is_resumed = self.journal.begin(address, factory)
        copy = await stream.copy_info()
        # What was said to a component at another address cannot be handled again at this one: it would do its tasks once more.
        begins_anew = self._joined.replaces or (not is_resumed and copy is not None and copy.address != address)
        follows = not begins_anew and self._joined.common_number is None
        stream.last = await stream.place_after(journaled.number) - 1 if follows else (await stream.bounds())[1]
        if follows and copy is not None and copy.history:
            note_joined(self.journal, copy.history, journaled.number)
        await self._wait_to_lead(stream, journaled, address, follows=follows)
        has_all, number_on_bus = False, 0
        while not has_all:
            if follows:
                number_on_bus = await self._follow(stream, journaled)
            elif not begins_anew:
                number_on_bus = await self._check_alone(stream)
            else:
                stream.last = (await stream.bounds())[1]
            has_all = await stream.begin_writing(0 if begins_anew else number_on_bus, begins_anew=begins_anew)
        stream.number = journaled.number
        copy = await stream.copy_info()
        await self._begin_history(stream, copy, begins_anew=begins_anew)
        is_copied = copy is not None and copy.address == address and bool(copy.history) and not begins_anew
        if not is_copied or number_on_bus < journaled.number:
            await self._copy(stream)
        return journaled, is_resumed or journaled.number > 0

    async def _wait_to_lead(self, stream: StreamLog, journaled: JournaledComponent, address: str, *, follows: bool) -> None:
        """Return when this process has the lease. Until then it `follows` the one that leads, if it has nothing that the bus lacks."""
        parent, is_said = parent_process(), False
        with stop_signals() as signals:
            while not await stream.acquire():
                if follows:
                    await self._follow(stream, journaled)
                elif not self._joined.replaces:
                    await self._check_alone(stream)
                if not is_said:
                    if not follows:
                        log.warning("%s waits until no other process leads: its file goes on without those on the bus", stream.component)
                    say_ready(stream.component, f"{address} (standby)")
                    is_said = True
                await stream.wait_for_news(RENEWAL)
                if not signals.empty():
                    raise SystemExit(0)
                if os.getppid() != parent:
                    raise RemoteError(f"{stream.component} ends, because the process that started it has ended")

    async def _check_alone(self, stream: StreamLog) -> int:
        """The number of the last entry on the bus, if it has not gone on without this file. Raises UsageError if it has."""
        stream.last = (await stream.bounds())[1]
        number, common_number = await stream.last_number(), self._joined.common_number
        if common_number is not None and number > common_number:
            raise UsageError(f"{stream.component} ends: another process has gone on meanwhile, without what {self.journal.disk.path} has")
        return number

    async def _begin_history(self, stream: StreamLog, copy: CopyInfo | None, *, begins_anew: bool) -> None:
        """Go on with the history on the bus, whose latest copy is `copy`, or begin one."""
        if copy is not None:
            self._replaced = (*copy.replaced, copy.history) if begins_anew and copy.history else copy.replaced
        self._history = copy.history if copy is not None and copy.history and not begins_anew else uuid.uuid4().hex
        note_joined(self.journal, self._history, self.journal.number)
        if begins_anew:
            await stream.forget_before(stream.last)

    async def _follow(self, stream: StreamLog, journaled: JournaledComponent) -> int:
        """Handle the entries on the bus that are new here. Returns the number of the last entry on the bus.

        Raises UsageError when they cannot be stored here: who cannot store cannot lead.
        """
        if self.journal.disk.failed is not None:
            raise UsageError(f"{stream.component} ends: {self.journal.disk.failed}")
        number = 0
        if stream.last:
            last_batch = await stream.batch(stream.last)
            number = last_batch.number if last_batch is not None else await stream.last_number()
        while (batch := await stream.batch(stream.last + 1)) is not None:
            if batch.begins_anew:
                raise UsageError(f"{stream.component} ends: its journal on the bus has begun anew; start it again")
            if batch.document:
                self.journal.follow(journaled, batch.document, batch.version)
            stream.last, number = batch.sequence, batch.number
            stream.number = journaled.number
            if self.journal.due:
                self.journal.snapshot(journaled)
        first, last_place = await stream.bounds()
        # A server that has just come back may answer before it knows of the last entries.
        if first > stream.last + 1 or (last_place < stream.last and await stream.is_made_anew()):
            raise UsageError(f"{stream.component} ends: only the copy on the bus has what it missed; start it again")
        return number

    async def _copy_at_times(self, stream: StreamLog) -> None:
        """Store a copy of the file whenever the stream has become long."""
        self._copied_to = (await stream.bounds())[0] - 1
        while True:
            await asyncio.sleep(RENEWAL)
            if stream.last - self._copied_to >= COPY_AFTER or stream.lacks_copy:
                stream.lacks_copy = False
                await self._copy(stream)

    async def _copy(self, stream: StreamLog) -> None:
        """Store a copy of the file on the bus, and delete the entries that it has from the stream."""
        await self.journal.disk.stored()
        place, number = stream.last, stream.number
        file = self.journal.disk.path.with_suffix(".copy")
        file.unlink(missing_ok=True)
        await asyncio.wrap_future(self.journal.disk.read(lambda db: db.execute("VACUUM INTO ?", (str(file),)) and None))
        info = CopyInfo(number=number, address=self.journal.address, history=self._history, replaced=self._replaced)
        await stream.store_copy(file, info)
        file.unlink()
        self._copied_to = place
        await stream.forget_before(place - KEPT)


@asynccontextmanager
async def continuing(bus: BusAddress | None, component: str, file: Path, open_journal: OpenJournal) -> AsyncIterator[Continuation]:
    """Open the journal of a component in its file, as `joining.join` says.

    Raises UsageError when the journal cannot be opened, or when a person has to choose with which one the component goes on.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    stream = StreamLog(bus.servers, bus.site, component, _identity(file.parent)) if bus is not None else None
    try:
        if stream is not None:
            await stream.open()
        joined = await join(stream, file, f"{bus.gateway}/{component}" if bus is not None else "", open_journal)
        try:
            yield Continuation(joined, stream)
        finally:
            if stream is not None:
                stream.end_writing()
            joined.journal.close()
            if stream is not None:
                await stream.resign()
    finally:
        if stream is not None:
            await stream.close()


def _identity(folder: Path) -> str:
    """The name by which the leases on a bus know a data folder: a process that is started again there has its lease at once."""
    file = folder / IDENTITY_FILE
    with contextlib.suppress(FileExistsError), file.open("x") as new_file:
        new_file.write(uuid.uuid4().hex)
    return file.read_text()

"""The journal of a component: the last snapshot of its state, the inputs since then, and the archive of its records.

A component that restarts takes its state from the journal and handles the later inputs again (`kernel.pending`). State and inputs have the
versions that the component's schema names: a later program reads those of earlier versions, and then writes its own.
"""

from __future__ import annotations

import functools
import sqlite3
import time
import zlib
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

import msgspec

from somrs.errors import UsageError
from somrs.kernel.codec import Schema
from somrs.kernel.component import Stateful
from somrs.kernel.durability import Entry, JournalCodec, JournaledComponent
from somrs.kernel.parts import Parts, PartsReader, PartsWriter, part_changes
from somrs.protocol.component_paths import scheme_change
from somrs.storage.archive import TaskArchive
from somrs.storage.bus_histories import forget_histories
from somrs.storage.disk import Disk
from somrs.storage.journal_file import (
    KIND,
    PROGRAM,
    StoredJournal,
    begin_with,
    read_stored_journal,
    write_batch,
    write_open,
    write_snapshot,
)

SNAPSHOT_SHARE = 0.02
"""The maximal share of the event loop's time for snapshots."""

MOST_BATCH = 500_000
"""The most bytes of several entries that are written as one batch: messages on a bus have a limit."""


class Contradiction(UsageError):
    """A record differs from the stored record of the same input; the text names it."""


class Archive(Protocol):
    """Stores and reads a component's `Record`s, in the file of its journal."""

    def store_record(self, record: object, db: sqlite3.Connection) -> None:
        """Store a record; storing it twice has no further effect."""
        ...

    def store_replayed(self, records: Sequence[object], state: Any, db: sqlite3.Connection) -> None:
        """Store the records of the replayed inputs, some of which may not have been on disk; the replay led to this state.

        Raises:
            Contradiction: a stored record of the same input differs.
        """
        ...

    async def answer(self, task: object, disk: Disk) -> object:
        """Perform a task of the component on the archive, without blocking the event loop."""
        ...


def _refuse_new(address: str) -> Stateful:
    raise UsageError(f"the journal of {address} has lost its state; restore a backup")


class Log(Protocol):
    """Where entries are kept besides the file, and before they are written to it: `stream_log.StreamLog`."""

    async def append(self, number: int, version: int, document: bytes) -> None:
        """Write a batch of entries, the last of which has this number. Raises UsageError."""
        ...


def _unchanged(text: str) -> str:
    return text


_TASKS = TaskArchive()


class Journal:
    """An open journal of a component with this schema.

    `address` is where the component was reached, `open` what it had not finished, and `number` that of the last entry; all are empty for a
    new file (`is_new`). `setting` holds what
    else the state depends on, such as the addresses of other components; it must not change. Components of one process can have journals in
    one file (`for_component`), so that one commit stores the simultaneous inputs of all. `archive` stores the component's records; an
    archive with tables of its own comes with the `disk` that has them. `log`: where entries are kept besides the file.
    """

    def __init__(
        self,
        path: Path,
        schema: Schema,
        setting: str = "",
        *,
        component: str = "",
        disk: Disk | None = None,
        archive: Archive = _TASKS,
        log: Log | None = None,
    ) -> None:
        self._log = log
        self.disk = disk if disk is not None else Disk(path, KIND, syncs=log is None)
        self._written, self._archive = JournalCodec(schema), archive
        self._setting, self._component = setting, component
        self._queued: deque[tuple[int, bytes]] = deque()
        self._logged: deque[tuple[int, bytes]] = deque()
        """Batches that are in the log, and are to be written to the file."""
        if log is not None:
            self.disk.store_first(self._write_to_log)
        self._entry_count = 0
        self._next_snapshot_time = 0.0
        self._stored_parts: Parts = {}
        """The parts of the last snapshot: the next one writes only what is different."""
        try:
            self._stored_journal = self.disk.write_and_wait(lambda db: read_stored_journal(db, component))
            self.disk.check_reached(component, self._stored_journal.number if self._stored_journal is not None else 0)
        except UsageError:
            self.disk.close()
            raise
        self.address = self._stored_journal.address if self._stored_journal is not None else ""
        self.open: tuple[str, ...] = tuple(self._stored_journal.open) if self._stored_journal is not None else ()
        self.is_new = self._stored_journal is None
        self.number = self._stored_journal.number if self._stored_journal is not None else 0

    def for_component(self, component: str) -> Journal:
        """Return the journal of another component of this process, in the same file. Closing one of them closes all."""
        return Journal(self.disk.path, self._written.schema, self._setting, component=component, disk=self.disk, archive=self._archive)

    def begin(self, address: str, factory: Callable[[str], Stateful]) -> tuple[JournaledComponent, bool]:
        """Return the component as it was after the last input, and whether there was one; otherwise, `factory` creates it for this address.

        Data of another version are converted at once, so that all data after a snapshot are of one program. So are addresses, when the
        components of the system have got certificates, or have lost them: `https` has taken the place of `http`, or the other way round.

        Raises:
            UsageError: the state cannot be continued and must not be dropped, or the replayed inputs lead to records that differ from those
                in the archive.
        """
        stored_journal, self._stored_journal, self.address = self._stored_journal, None, address
        with_scheme = scheme_change(stored_journal.address, address) if stored_journal is not None else None
        if stored_journal is not None and (change := self._changed(stored_journal, address, with_scheme or _unchanged)) is not None:
            if stored_journal.open or self._written.schema.irreplaceable:
                raise UsageError(self._stuck(stored_journal, change))
            stored_journal = None
        if stored_journal is None:
            self.disk.write_and_wait(forget_histories)
            journaled = JournaledComponent(factory(address), self._written.schema)
            self._begin_anew(address, journaled)
            return journaled, False
        try:
            journaled = self._replayed(stored_journal)
        except UsageError:
            raise
        except Exception as error:  # data that do not fit may raise any exception
            raise UsageError(self._stuck(stored_journal, f"cannot be read ({type(error).__name__}: {error})")) from error
        if with_scheme is not None:
            # Only now: what was said in the earlier addresses has to be handled with them, or its records would be other ones.
            journaled = self._written.converted(journaled, with_scheme)
        if with_scheme is not None or (stored_journal.schema, stored_journal.program) != (self._written.schema.version, PROGRAM):
            self._begin_anew(address, journaled)
            self._entry_count = 0
        return journaled, True

    def can_continue_at(self, address: str) -> bool:
        """Whether the journal that the file has can be continued at this address. Ask before `begin`."""
        if self._stored_journal is None:
            return False
        with_scheme = scheme_change(self._stored_journal.address, address)
        return self._changed(self._stored_journal, address, with_scheme or _unchanged) is None

    def reread(self) -> JournaledComponent:
        """Return the component as the file has it, after a write that failed. What was not written is forgotten.

        Raises:
            UsageError: the file cannot be read or written.
        """
        self._queued.clear()
        self._stored_journal = self.disk.write_and_wait(lambda db: read_stored_journal(db, self._component))
        journaled, _ = self.begin(self.address, _refuse_new)
        self.open, self.number = tuple(journaled.component.open), journaled.number
        return journaled

    def _changed(self, stored_journal: StoredJournal, address: str, with_scheme: Callable[[str], str]) -> str | None:
        """Return why the journal cannot be continued; None if it can. `with_scheme` gives addresses the scheme that they have now."""
        if not self._written.schema.can_read(stored_journal.schema):
            return f"was written by {stored_journal.program}, whose state {PROGRAM} cannot read"
        if with_scheme(stored_journal.setting) != self._setting:
            return f"was written for {stored_journal.setting}, and this is for {self._setting}"
        if with_scheme(stored_journal.address) != address and not self._written.schema.relocatable:
            return f"belongs to {stored_journal.address}, where other components expect its owner, and this is {address}"
        return None

    def _stuck(self, stored_journal: StoredJournal, change: str) -> str:
        problem = f"{self.disk.path}: {change}"
        if self._written.schema.irreplaceable:
            return f"{problem}; use the earlier program and settings, restore a backup, or move the file away, which loses its contents"
        if not stored_journal.open:
            return f"{problem}; no task was open in it: move the file away"
        named = ", ".join(stored_journal.open[:3]) + (" ..." if len(stored_journal.open) > 3 else "")
        tasks = f"{len(stored_journal.open)} task{'s are' if len(stored_journal.open) > 1 else ' is'} open ({named})"
        return f"{problem}; {tasks}: use the earlier program and settings until they are over, or move the file away, which loses them"

    def _replayed(self, stored_journal: StoredJournal) -> JournaledComponent:
        if zlib.crc32(stored_journal.state) != stored_journal.sum:
            raise UsageError(self._stuck(stored_journal, "is damaged: its state is not the one that was written"))
        parts = PartsReader(stored_journal.parts)
        journaled = self._written.decode_snapshot(stored_journal.state, stored_journal.schema, parts)
        self._stored_parts = parts.parts
        entries = [entry for document in stored_journal.entries for entry in self._written.decode_batch(document, stored_journal.schema)]
        entries = [entry for entry in entries if entry.number > journaled.number]
        self._entry_count = len(entries)
        try:
            records = journaled.replay(entries)
        except ValueError as error:
            raise UsageError(self._stuck(stored_journal, f"is damaged: {error}")) from None
        archive_records, state = [record.entry for record in records], journaled.component.state
        try:
            self.disk.write_and_wait(lambda db: self._archive.store_replayed(archive_records, state, db))
        except Contradiction as error:
            advice = f"it was written by {stored_journal.program}: start that once more and stop it normally, then continue with {PROGRAM}"
            raise UsageError(f"{self.disk.path}: {error}; {advice}") from None
        return journaled

    # Writing

    def append(self, entry: Entry) -> None:
        """Request that the entry is written to disk."""
        self._queued.append((entry.number, self._written.encode_entry(entry)))
        self.number = entry.number
        self._entry_count += 1
        self.disk.write(self._flush)

    def store_record(self, record: object) -> None:
        """Request that a record is stored in the archive."""
        self.disk.write(functools.partial(self._archive.store_record, record))

    def note(self, component: Stateful) -> None:
        """Request that the component's unfinished work is written to disk, if it changed."""
        now_open = tuple(component.open)
        if now_open != self.open:
            self.open = now_open
            self.disk.write(lambda db: write_open(db, self._component, now_open))

    @property
    def due(self) -> bool:
        """Whether it is time for a snapshot."""
        return self._entry_count >= self._written.schema.snapshot_after and time.monotonic() >= self._next_snapshot_time

    @property
    def overdue(self) -> bool:
        """Whether a snapshot must not wait for an idle moment."""
        return self.due and self._entry_count >= 4 * self._written.schema.snapshot_after

    def snapshot(self, journaled: JournaledComponent) -> None:
        """Request that the state is written to disk and the entries before it are deleted, both or neither."""
        start_time = time.monotonic()
        parts = PartsWriter()
        state = self._written.encode_snapshot(journaled, parts)
        changes = part_changes(self._stored_parts, parts.parts)
        self._entry_count, self._stored_parts = 0, parts.parts
        self._next_snapshot_time = time.monotonic() + (time.monotonic() - start_time) / SNAPSHOT_SHARE
        number, timestamp = journaled.number, journaled.time
        self.disk.write(lambda db: write_snapshot(db, self._component, number, timestamp, state, changes))

    def close(self) -> None:
        """Complete the requested writes, and close the file."""
        self.disk.close()

    async def _write_to_log(self) -> None:
        """Write all queued entries to the log."""
        assert self._log is not None, "only a journal with a log calls this"
        while self._queued:
            last_number, document = self._next_batch()
            await self._log.append(last_number, self._written.schema.version, document)
            self._logged.append((last_number, document))

    def _flush(self, db: sqlite3.Connection) -> None:
        """Write all entries that are to be written, including those of later requests, which then find nothing to write."""
        while self._logged:
            write_batch(db, self._component, *self._logged.popleft())
        while self._queued and self._log is None:
            last_number, document = self._next_batch()
            write_batch(db, self._component, last_number, document)
            self.disk.reach(self._component, last_number)

    def _next_batch(self) -> tuple[int, bytes]:
        """The first queued entries as one document, and the number of the last of them."""
        entries: list[bytes] = []
        size = last_number = 0
        while self._queued and (not entries or size + len(self._queued[0][1]) <= MOST_BATCH):
            last_number, entry = self._queued.popleft()
            entries.append(entry)
            size += len(entry)
        return last_number, JournalCodec.encode_batch(entries)

    def follow(self, journaled: JournaledComponent, document: bytes, version: int) -> None:
        """Handle a batch of entries that another process has written, and request that they are written to disk here.

        Raises UsageError when they do not follow on the last one, or were written by a later program.
        """
        try:
            entries = [entry for entry in self._written.decode_batch(document, version) if entry.number > journaled.number]
            records = journaled.replay(entries)
        except (ValueError, msgspec.MsgspecError) as error:
            raise UsageError(f"{self.disk.path}: entries on the bus cannot be continued here: {error}") from None
        if not entries:
            return
        own_document = JournalCodec.encode_batch([self._written.encode_entry(entry) for entry in entries])
        self.disk.write(lambda db: write_batch(db, self._component, entries[-1].number, own_document))
        for record in records:
            self.store_record(record.entry)
        self.note(journaled.component)
        self.number = journaled.number
        self._entry_count += len(entries)

    def _begin_anew(self, address: str, journaled: JournaledComponent) -> None:
        def begin(db: sqlite3.Connection) -> Parts:
            self.disk.begin_at(self._component, journaled.number)
            return begin_with(db, journaled, self._written, self._component, self._setting, address)

        self._stored_parts = self.disk.write_and_wait(begin)

    async def carry_out(self, task: object, report: object = None) -> object:
        """Perform a task of the component on its archive, without blocking the event loop. There are no partial answers."""
        return await self._archive.answer(task, self.disk)

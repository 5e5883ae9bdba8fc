"""The records of ended tasks, read from the Task Managers of a running system, or from the journals of a stopped one."""

from __future__ import annotations

import sqlite3
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
from msgspec import structs

from somrs.client.addresses import SYSTEM_FILE, Addresses, task_manager_name
from somrs.client.client import Client
from somrs.client.joined_records import join_records, of_task_manager
from somrs.errors import RemoteError, UsageError
from somrs.protocol.messages.records import ReadRecords, Records, TaskRecord
from somrs.storage import archive
from somrs.storage.journal_file import KIND
from somrs.storage.locking import is_locked

BUSY_TIME = 1.0
"""Seconds to wait for a journal that another process holds open."""


class TaskHistory:
    """Reads the records of ended tasks. `client`: the client of the running system; None if no system runs."""

    def __init__(self, ask: Callable[[ReadRecords], Awaitable[Records]], client: Client | None = None) -> None:
        self._ask, self.client = ask, client
        self.silent: dict[str, None] = {}
        """The Task Managers that did not answer so far; their records are missing."""

    async def pages(self, query: ReadRecords) -> AsyncIterator[Records]:
        """All records that match the query, page by page, each record complete. `query.limit` is the size of a page."""
        while True:
            page = await self._ask(query)
            self.silent |= dict.fromkeys(page.silent)
            if page.rest is not None:
                page = structs.replace(page, records=(*page.records[:-1], await self._read_rest(page.records[-1], page.rest, query)))
            yield page
            if not page.more or not page.records:
                return
            query = structs.replace(query, behind=page.records[-1].task)

    async def first(self, query: ReadRecords, count: int) -> list[TaskRecord]:
        """The first `count` records that match the query."""
        records: list[TaskRecord] = []
        async for page in self.pages(structs.replace(query, limit=count)):
            records += page.records
            if len(records) >= count:
                break
        return records[:count]

    async def _read_rest(self, record: TaskRecord, offset: int, query: ReadRecords) -> TaskRecord:
        rest: int | None = offset
        while rest is not None:
            page = await self._ask(ReadRecords(task=record.task, after=rest, brief=query.brief, without=query.without))
            if not page.records:
                raise RemoteError(f"there is no longer a record of {record.task}")
            record, rest = archive.joined(record, page.records[0]), page.rest
        return record


@asynccontextmanager
async def open_task_history(data: Path, site: Addresses | None = None) -> AsyncIterator[TaskHistory]:
    """The records of ended tasks of a site that runs elsewhere, or those in a data folder. Raises UsageError if there are none."""
    if site is not None:
        async with Client(site) as client:
            yield TaskHistory(client.records, client)
        return
    files = archive.archive_files(data)
    if not (data / SYSTEM_FILE).exists() and not files:
        Addresses.read(data)
    if (data / SYSTEM_FILE).exists():
        async with Client(Addresses.read(data)) as client:
            try:
                await client.records(ReadRecords(limit=0, brief=True))
            except RemoteError:
                if not files:
                    raise
            else:
                yield TaskHistory(client.records, client)
                return
    journals: dict[Path, sqlite3.Connection] = {}

    async def read_pages(query: ReadRecords) -> list[Records]:
        names = [task_manager_name(number) if len(files) > 1 else "" for number in range(1, len(files) + 1)]
        return [of_task_manager(_read(query, file, db), name) for name, (file, db) in zip(names, journals.items(), strict=True)]

    try:
        for file in files:
            journals[file] = _open_journal(file)
        yield TaskHistory(lambda query: join_records(query, read_pages))
    finally:
        for db in journals.values():
            db.close()


def _read(query: ReadRecords, file: Path, db: sqlite3.Connection) -> Records:
    try:
        return archive.find_records(query, db)
    except sqlite3.DatabaseError as error:
        raise _unreadable(file, error) from None
    except msgspec.MsgspecError as error:
        raise UsageError(f"{file}: contains an invalid record of a task ({error}); restore a copy of the file") from None


def _open_journal(file: Path) -> sqlite3.Connection:
    """Open the journal read-only; meanwhile no Task Manager can open it for writing."""
    try:
        db = sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True, timeout=BUSY_TIME)
        (application,) = db.execute("PRAGMA application_id").fetchone()
        (version,) = db.execute("PRAGMA user_version").fetchone()
    except sqlite3.DatabaseError as error:
        raise _unreadable(file, error) from None
    if application != KIND.application or not 1 <= version <= KIND.version:  # the format of records is the same in all versions
        db.close()
        raise UsageError(f"{file}: is not {KIND.owner} file, or another version of SO-MRS wrote it; read it with that version")
    return db


def _unreadable(file: Path, error: sqlite3.DatabaseError) -> UsageError:
    if is_locked(error):
        return UsageError(f"{file}: is in use by a Task Manager that does not answer; wait until it does, or stop it")
    return UsageError(f"{file}: cannot be read: {error}")

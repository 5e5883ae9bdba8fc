"""Tasks that are over, read from whoever has them: the Task Manager of a system that runs, or the journal of one that does not."""

from __future__ import annotations

import sqlite3
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
from msgspec import structs

from somrs.client.client import SYSTEM_FILE, Addresses, Client
from somrs.errors import RemoteError, UsageError
from somrs.protocol.messages.records import ReadRecords, Records, TaskRecord
from somrs.storage import archive
from somrs.storage.journal import KIND

BUSY_TIME = 1.0
"""Seconds that a journal which another process has open is waited for."""


class TaskHistory:
    """Answers what is asked of tasks that are over. `client` asks the running system, and is None when none runs."""

    def __init__(self, ask: Callable[[ReadRecords], Awaitable[Records]], client: Client | None = None) -> None:
        self._ask, self.client = ask, client

    async def pages(self, query: ReadRecords) -> AsyncIterator[Records]:
        """All that is asked for, page by page, each record whole; `limit` is a page's."""
        while True:
            page = await self._ask(query)
            if page.rest is not None:
                page = structs.replace(page, records=(*page.records[:-1], await self._read_rest(page.records[-1], page.rest, query)))
            yield page
            if not page.more or not page.records:
                return
            query = structs.replace(query, behind=page.records[-1].task)

    async def first(self, query: ReadRecords, count: int) -> list[TaskRecord]:
        """The first so many of what is asked for."""
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
                raise RemoteError(f"{record.task} is not kept any more")
            record, rest = archive.joined(record, page.records[0]), page.rest
        return record


@asynccontextmanager
async def open_task_history(data: Path) -> AsyncIterator[TaskHistory]:
    """What is over, in the system of a data folder. Raises UsageError when nothing is kept there."""
    file = data / archive.FILE
    if not (data / SYSTEM_FILE).exists() and not file.exists():
        Addresses.read(data)
    if (data / SYSTEM_FILE).exists():
        async with Client(Addresses.read(data)) as client:
            try:
                await client.records(ReadRecords(limit=0, brief=True))
            except RemoteError:
                if not file.exists():
                    raise
            else:
                yield TaskHistory(client.records, client)
                return
    db = _open_journal(file)
    try:
        yield TaskHistory(lambda query: _read(query, file, db))
    finally:
        db.close()


async def _read(query: ReadRecords, file: Path, db: sqlite3.Connection) -> Records:
    try:
        return archive.find_records(query, db)
    except sqlite3.DatabaseError as error:
        raise _unreadable(file, error) from None
    except msgspec.MsgspecError as error:
        raise UsageError(f"{file}: holds something that is no record of a task ({error}); put a copy back") from None


def _open_journal(file: Path) -> sqlite3.Connection:
    """The journal, to be read only; nobody else can open it for writing meanwhile."""
    try:
        db = sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True, timeout=BUSY_TIME)
        (application,) = db.execute("PRAGMA application_id").fetchone()
        (version,) = db.execute("PRAGMA user_version").fetchone()
    except sqlite3.DatabaseError as error:
        raise _unreadable(file, error) from None
    if application != KIND.application or not 1 <= version <= KIND.version:  # its records are the same in every format
        db.close()
        raise UsageError(f"{file}: is not {KIND.owner} file, or of another version of SO-MRS; read it with the one that wrote it")
    return db


def _unreadable(file: Path, error: sqlite3.DatabaseError) -> UsageError:
    if error.sqlite_errorname in ("SQLITE_BUSY", "SQLITE_LOCKED"):
        return UsageError(f"{file}: is in use by a Task Manager that does not answer; wait until it does, or stop it")
    return UsageError(f"{file}: cannot be read: {error}")

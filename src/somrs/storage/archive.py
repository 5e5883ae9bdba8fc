"""The archive of a journal: what is kept of tasks that are over, and how it is read by pages that fit a message.

A record may be longer than a message. It comes in parts then, each with some of its steps, work, contracts, events and messages.
"""

from __future__ import annotations

import asyncio
import functools
import sqlite3
from collections.abc import Iterable, Sequence

import msgspec
from msgspec import structs

from somrs.protocol.messages.envelope import normalised_id
from somrs.protocol.messages.paging import PAGE_BYTES, fit_page, size
from somrs.protocol.messages.records import PARTS as LISTS
from somrs.protocol.messages.records import ReadRecords, Records, TaskRecord
from somrs.storage.disk import Disk

FILE = "task-manager.sqlite"
"""In the data folder: the Task Manager's journal, which has the archive in it."""

TABLES = """
    CREATE TABLE records (task TEXT PRIMARY KEY, submitted_at REAL NOT NULL, ended_at REAL NOT NULL, outcome TEXT NOT NULL,
      effect TEXT NOT NULL, document TEXT NOT NULL);
    CREATE INDEX records_by_end ON records (ended_at);
"""

MOST_RECORDS = 200
"""On one page."""

LONG = ("contracts", "events", "messages")
"""Those that are left out of a brief record."""

WORKED = """instr(document, ?) > 0 AND EXISTS (SELECT 1 FROM json_each(document, '$.work') AS one
  WHERE json_extract(one.value, '$.service') = ? OR instr(json_extract(one.value, '$.service'), ?) = 1)"""
"""Whether a service, or one of a device, did something. Documents in which its name does not even stand are not taken apart."""

_RECORD = msgspec.json.Decoder(TaskRecord)


class TaskArchive:
    """The archive of a Task Manager's journal, as `journal.Archive`. Whoever has no tasks keeps nothing in it."""

    def keep(self, record: object, db: sqlite3.Connection) -> None:
        assert isinstance(record, TaskRecord), f"an archive is of tasks, not of {type(record).__name__}"
        keep(record, db)

    def again(self, records: Sequence[object], state: object, db: sqlite3.Connection) -> None:
        """A record that is another than before takes its place: nothing else follows from it."""
        for record in records:
            self.keep(record, db)

    async def answer(self, task: object, disk: Disk) -> Records:
        assert isinstance(task, ReadRecords), f"an archive is of tasks, and knows nothing of {type(task).__name__}"
        return await asyncio.wrap_future(disk.read(functools.partial(find, task)))


def keep(record: TaskRecord, db: sqlite3.Connection) -> None:
    """Put a record in the archive; the same one twice is there once."""
    document = msgspec.json.encode(record).decode()
    values = (record.task, record.submitted_at, record.ended_at, record.outcome.value, record.effect, document)
    db.execute("INSERT OR REPLACE INTO records VALUES (?, ?, ?, ?, ?, ?)", values)


def find(wanted: ReadRecords, db: sqlite3.Connection) -> Records:
    """The page that is asked for."""
    where, values = _condition(wanted)
    total: int | None = None
    if wanted.behind is None:
        (total,) = db.execute(f"SELECT count(*) FROM records WHERE {where}", values).fetchone()
    else:
        where += " AND (ended_at, task) < (SELECT ended_at, task FROM records WHERE task = ?)"
        values.append(wanted.behind)
    limit = min(max(wanted.limit, 0), MOST_RECORDS)
    rows = db.execute(f"SELECT document FROM records WHERE {where} ORDER BY ended_at DESC, task DESC LIMIT ?", [*values, limit + 1])
    return _page((_RECORD.decode(document) for (document,) in rows), wanted, limit, total)


def _condition(wanted: ReadRecords) -> tuple[str, list[object]]:
    parts: list[str] = ["TRUE"]
    values: list[object] = []
    if wanted.task is not None:
        id = normalised_id(wanted.task)
        beginning = id if id.startswith("urn:uuid:") else f"urn:uuid:{id.lower()}"
        parts.append("substr(task, 1, ?) = ?")
        values += [len(beginning), beginning]
    if wanted.since is not None:
        parts.append("ended_at >= ?")
        values.append(wanted.since)
    if wanted.outcome is not None:
        parts.append("outcome = ?")
        values.append(wanted.outcome.value)
    if wanted.text:
        parts.append("instr(lower(effect), lower(?)) > 0")
        values.append(wanted.text)
    if wanted.service:
        parts.append(WORKED)
        values += [f'"service":"{wanted.service}', wanted.service, f"{wanted.service}."]
    return " AND ".join(parts), values


def _page(found: Iterable[TaskRecord], wanted: ReadRecords, limit: int, total: int | None) -> Records:
    page: list[TaskRecord] = []
    room = PAGE_BYTES
    for number, record in enumerate(found):
        left_out = {*wanted.without} & {*LISTS} | ({*LONG} if wanted.brief else set())
        whole = _without(record, left_out) if left_out else record
        if number >= limit or (page and size(whole) > room):
            return Records(records=tuple(page), more=True, total=total)
        part, rest = cut(whole, wanted.after, room)
        page.append(part)
        room -= size(part)
        if rest is not None:
            return Records(records=tuple(page), more=True, total=total, rest=rest)
    return Records(records=tuple(page), total=total)


def cut(record: TaskRecord, after: int, room: int = PAGE_BYTES) -> tuple[TaskRecord, int | None]:
    """The record with as many of its parts behind the first `after` as fit; how many parts that makes, or None if these are the last."""
    parts = [(name, part) for name in LISTS for part in getattr(record, name)][max(after, 0) :]
    bare = _without(record, LISTS)
    page = list(fit_page(parts, len(parts), room - size(bare)))
    kept = {name: tuple(part for of, part in page if of == name) for name in LISTS}
    return structs.replace(bare, **kept), (max(after, 0) + len(page) if len(page) < len(parts) else None)


def joined(record: TaskRecord, rest: TaskRecord) -> TaskRecord:
    """The record with further parts of it."""
    return structs.replace(record, **{name: (*getattr(record, name), *getattr(rest, name)) for name in LISTS})


def _without(record: TaskRecord, lists: Iterable[str]) -> TaskRecord:
    return structs.replace(record, **dict.fromkeys(lists, ()))

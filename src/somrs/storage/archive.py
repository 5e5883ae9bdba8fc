"""The archive in a Task Manager's journal: the records of tasks that are over, read in pages that fit a message.

A record may be longer than a message. It is then read in parts, each with some of its steps, work, contracts, events and messages.
"""

from __future__ import annotations

import asyncio
import functools
import itertools
import sqlite3
from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec
from msgspec import structs

from somrs.protocol.messages.envelope import normalised_id
from somrs.protocol.messages.paging import PAGE_BYTES, fit_page, size
from somrs.protocol.messages.records import PARTS as LISTS
from somrs.protocol.messages.records import ReadRecords, Records, TaskRecord
from somrs.storage.disk import Disk

FILE = "task-manager.sqlite"
"""The Task Manager's journal in the data folder, with the archive in it. Further Task Managers have a number in the name."""

TABLES = """
    CREATE TABLE records (task TEXT PRIMARY KEY, submitted_at REAL NOT NULL, ended_at REAL NOT NULL, outcome TEXT NOT NULL,
      effect TEXT NOT NULL, document TEXT NOT NULL);
    CREATE INDEX records_by_end ON records (ended_at);
"""

MOST_RECORDS = 200
"""The maximal number of records on a page."""

LONG = ("contracts", "events", "messages")
"""The parts that a brief record omits."""

WORKED = """instr(document, ?) > 0 AND EXISTS (SELECT 1 FROM json_each(document, '$.work') AS one
  WHERE json_extract(one.value, '$.service') = ? OR instr(json_extract(one.value, '$.service'), ?) = 1)"""
"""Whether a service, or a service of a device, took part. Documents that do not contain its name are not parsed."""

_RECORD = msgspec.json.Decoder(TaskRecord)


def archive_file(data: Path, number: int = 1) -> Path:
    """The journal of the Task Manager with this number, counted from 1."""
    return data / (FILE if number == 1 else f"{Path(FILE).stem}-{number}{Path(FILE).suffix}")


def archive_files(data: Path) -> list[Path]:
    """The journals of all Task Managers that a data folder has had: those with the numbers 1, 2, ..."""
    files = itertools.takewhile(Path.exists, (archive_file(data, number) for number in itertools.count(1)))
    return [*files]


class TaskArchive:
    """The archive of a Task Manager's journal, as `journal.Archive`. The other components write no records to it."""

    def store_record(self, record: object, db: sqlite3.Connection) -> None:
        assert isinstance(record, TaskRecord), f"an archive is of tasks, not of {type(record).__name__}"
        store_record(record, db)

    def store_replayed(self, records: Sequence[object], state: object, db: sqlite3.Connection) -> None:
        """Store the records. A record that differs from the stored one replaces it: nothing else depends on it."""
        for record in records:
            self.store_record(record, db)

    async def answer(self, task: object, disk: Disk) -> Records:
        assert isinstance(task, ReadRecords), f"an archive is of tasks, and knows nothing of {type(task).__name__}"
        return await asyncio.wrap_future(disk.read(functools.partial(find_records, task)))


def store_record(record: TaskRecord, db: sqlite3.Connection) -> None:
    """Store a record. What is stored already is not written again: while a disk cannot be written, a journal is read once more."""
    document = msgspec.json.encode(record).decode()
    values = (record.task, record.submitted_at, record.ended_at, record.outcome.value, record.effect, document)
    stored = db.execute("SELECT * FROM records WHERE task = ?", [record.task]).fetchone()
    if stored != values:
        db.execute("INSERT OR REPLACE INTO records VALUES (?, ?, ?, ?, ?, ?)", values)


def find_records(query: ReadRecords, db: sqlite3.Connection) -> Records:
    """Return the page of records that the query selects."""
    condition, values = _condition(query)
    total: int | None = None
    if query.behind is None:
        (total,) = db.execute(f"SELECT count(*) FROM records WHERE {condition}", values).fetchone()
    elif query.behind_at is not None:
        condition += " AND (ended_at, task) < (?, ?)"
        values += [query.behind_at, query.behind]
    else:
        condition += " AND (ended_at, task) < (SELECT ended_at, task FROM records WHERE task = ?)"
        values.append(query.behind)
    limit = min(max(query.limit, 0), MOST_RECORDS)
    rows = db.execute(f"SELECT document FROM records WHERE {condition} ORDER BY ended_at DESC, task DESC LIMIT ?", [*values, limit + 1])
    return _page((_RECORD.decode(document) for (document,) in rows), query, limit, total)


def _condition(query: ReadRecords) -> tuple[str, list[object]]:
    parts: list[str] = ["TRUE"]
    values: list[object] = []
    if query.task is not None:
        id = normalised_id(query.task)
        beginning = id if id.startswith("urn:uuid:") else f"urn:uuid:{id.lower()}"
        parts.append("substr(task, 1, ?) = ?")
        values += [len(beginning), beginning]
    if query.since is not None:
        parts.append("ended_at >= ?")
        values.append(query.since)
    if query.outcome is not None:
        parts.append("outcome = ?")
        values.append(query.outcome.value)
    if query.text:
        parts.append("instr(lower(effect), lower(?)) > 0")
        values.append(query.text)
    if query.service:
        parts.append(WORKED)
        values += [f'"service":"{query.service}', query.service, f"{query.service}."]
    return " AND ".join(parts), values


def _page(records: Iterable[TaskRecord], query: ReadRecords, limit: int, total: int | None) -> Records:
    page: list[TaskRecord] = []
    free_bytes = PAGE_BYTES
    for number, record in enumerate(records):
        omitted_lists = {*query.without} & {*LISTS} | ({*LONG} if query.brief else set())
        whole = _drop_lists(record, omitted_lists) if omitted_lists else record
        if number >= limit or (page and size(whole) > free_bytes):
            return Records(records=tuple(page), more=True, total=total)
        part, rest = _cut(whole, query.after, free_bytes)
        page.append(part)
        free_bytes -= size(part)
        if rest is not None:
            return Records(records=tuple(page), more=True, total=total, rest=rest)
    return Records(records=tuple(page), total=total)


def _cut(record: TaskRecord, offset: int, free_bytes: int = PAGE_BYTES) -> tuple[TaskRecord, int | None]:
    """Return the record with as many of its parts after the first `offset` as fit, and the next offset; None if these are the last."""
    parts = [(name, part) for name in LISTS for part in getattr(record, name)][max(offset, 0) :]
    bare = _drop_lists(record, LISTS)
    page = list(fit_page(parts, len(parts), free_bytes - size(bare)))
    part_lists = {name: tuple(part for list_name, part in page if list_name == name) for name in LISTS}
    return structs.replace(bare, **part_lists), (max(offset, 0) + len(page) if len(page) < len(parts) else None)


def joined(record: TaskRecord, rest: TaskRecord) -> TaskRecord:
    """Return the record with the parts of both."""
    return structs.replace(record, **{name: (*getattr(record, name), *getattr(rest, name)) for name in LISTS})


def _drop_lists(record: TaskRecord, lists: Iterable[str]) -> TaskRecord:
    return structs.replace(record, **dict.fromkeys(lists, ()))

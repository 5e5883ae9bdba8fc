"""The records of several Task Managers in pages of one list: as if they were in one archive."""

from __future__ import annotations

import asyncio
import sqlite3
from collections.abc import Sequence

from hypothesis import given, settings
from hypothesis import strategies as st

from somrs.client.joined_records import join_records
from somrs.client.task_history import TaskHistory
from somrs.protocol.messages.envelope import message_id
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.records import ReadRecords, Records, TaskRecord
from somrs.protocol.messages.task_views import TaskEvent
from somrs.storage import archive

LONG = 60_000
"""The size of an event of a record that does not fit on a page with others."""


def record_of(number: int, ended_at: float, events: int) -> TaskRecord:
    texts = tuple(TaskEvent(number=index, at=0.0, text="x" * LONG) for index in range(events))
    return TaskRecord(
        task=message_id("task", number), client="", effect="", submitted_at=0.0, ended_at=ended_at, outcome=Outcome.FAILED, events=texts
    )


def archive_of(records: Sequence[TaskRecord]) -> sqlite3.Connection:
    db = sqlite3.connect(":memory:")
    db.executescript(archive.TABLES)
    for record in records:
        archive.store_record(record, db)
    return db


def all_records(query: ReadRecords, archives: Sequence[sqlite3.Connection]) -> tuple[list[TaskRecord], list[Records]]:
    """All records page by page, as clients read them, and the pages."""
    pages: list[Records] = []

    async def read_pages(page_query: ReadRecords) -> list[Records]:
        return [archive.find_records(page_query, db) for db in archives]

    async def ask(page_query: ReadRecords) -> Records:
        pages.append(await join_records(page_query, read_pages))
        return pages[-1]

    async def read_all() -> list[TaskRecord]:
        return [record async for page in TaskHistory(ask).pages(query) for record in page.records]

    return asyncio.run(read_all()), pages


records_of_managers = st.lists(st.lists(st.tuples(st.integers(0, 5), st.sampled_from([0, 0, 0, 1, 3])), max_size=8), min_size=1, max_size=3)
"""For each Task Manager the records: when they ended, and how many long events they have. Many end at the same time."""


@settings(deadline=None)
@given(records_of_managers, st.integers(1, 5))
def test_all_come_back_in_order_once_and_whole(managers: list[list[tuple[int, int]]], limit: int) -> None:
    numbers = iter(range(100))
    lists = [[record_of(next(numbers), float(ended_at), events) for ended_at, events in records] for records in managers]
    joined, pages = all_records(ReadRecords(limit=limit), [archive_of(records) for records in lists])
    expected = sorted((record for records in lists for record in records), key=lambda record: (record.ended_at, record.task), reverse=True)
    assert joined == expected
    assert all(len(page.records) <= limit for page in pages)
    assert pages[0].total == len(expected)


def test_a_page_behind_a_task_without_a_record_is_empty() -> None:
    joined, pages = all_records(ReadRecords(behind="urn:uuid:nowhere"), [archive_of([record_of(1, 1.0, 0)]), archive_of([])])
    assert joined == []
    assert not pages[0].more

"""The records of ended tasks of several Task Managers, in pages of one list."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence

from msgspec import structs

from somrs.protocol.messages.records import PARTS, ReadRecords, Records, TaskRecord

ReadPages = Callable[[ReadRecords], Awaitable[Sequence[Records]]]
"""Reads a page of the records of each Task Manager."""


async def join_records(query: ReadRecords, read_pages: ReadPages) -> Records:
    """Return a page of the list that the Task Managers have together, the latest first."""
    if query.behind is not None:
        query = structs.replace(query, behind_at=await _end(query.behind, read_pages))
        if query.behind_at is None:
            return Records(records=())
    return join_pages(query, await read_pages(query))


async def _end(task: str, read_pages: ReadPages) -> float | None:
    """When the task ended; None if there is no record of it."""
    pages = await read_pages(ReadRecords(task=task, limit=1, brief=True, without=PARTS))
    return next((record.ended_at for page in pages for record in page.records if record.task == task), None)


def join_pages(query: ReadRecords, pages: Sequence[Records]) -> Records:
    """Return the pages as one. It ends with the last record of the first page that others follow: those may come before the rest of the
    other pages."""
    records = sorted((record for page in pages for record in page.records), key=_place, reverse=True)
    complete_until = max((_place(page.records[-1]) for page in pages if page.more and page.records), default=(0.0, ""))
    joined = [record for record in records if _place(record) >= complete_until][: max(query.limit, 0)]
    totals = [page.total for page in pages if page.total is not None]
    rests = (page.rest for page in pages if page.rest is not None and joined and page.records[-1] is joined[-1])
    return Records(
        records=tuple(joined),
        more=len(joined) < len(records) or any(page.more for page in pages),
        rest=next(rests, None),
        total=sum(totals) if len(totals) == len(pages) else None,
    )


def of_task_manager(page: Records, name: str) -> Records:
    """Return the page with the name of the Task Manager in its records."""
    return structs.replace(page, records=tuple(structs.replace(record, task_manager=name) for record in page.records))


def _place(record: TaskRecord) -> tuple[float, str]:
    """The order of the list: the latest first."""
    return record.ended_at, record.task

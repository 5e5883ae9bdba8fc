"""Tasks that are over: found, read, exported."""

from __future__ import annotations

import io
import time
from datetime import datetime

from somrs.api.context import Context
from somrs.client.export import PAGE, Format, Table, moment, write
from somrs.client.operations import Document, operation
from somrs.client.refusals import NotFound
from somrs.client.task_history import TaskHistory
from somrs.errors import UsageError
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.records import ReadRecords, Records, TaskRecord

MEDIA_TYPES = {Format.JSONL: "application/jsonl", Format.CSV: "text/csv; charset=utf-8"}


class RecordService:
    def __init__(self, context: Context) -> None:
        self._client = context.client
        self._task_history = TaskHistory(context.client.records, context.client)

    @operation("GET", "/records")
    async def find(
        self,
        since: str | None = None,
        outcome: Outcome | None = None,
        text: str | None = None,
        service: str | None = None,
        limit: int = 50,
        behind: str | None = None,
    ) -> Records:
        """Tasks that are over, the latest first, without terms, events and messages.

        `since`: those that ended at this date (2026-03-01), with a time (2026-03-01T14:30), or so long ago (2h), or later. `text`: in what
        was wished for. `service`: those in which this service, or a service of this device, did something. A page may end early; `more`
        says so, and `behind` (the last task of a page) asks for the next.
        """
        return await self._client.records(_make_query(since, outcome, text, service, limit, behind, brief=True))

    @operation("GET", "/records/{id}")
    async def read(self, id: str) -> TaskRecord:
        """Everything of a task that is over: plan, work, terms, events, messages. The beginning of its id will do."""
        records = (await self._client.records(ReadRecords(task=id, limit=2, brief=True))).records
        if len(records) != 1:
            problem = "several ids begin" if records else "no id begins"
            raise NotFound(f"of the tasks that are over, {problem} with {id}")
        return (await self._task_history.first(ReadRecords(task=records[0].task), 1))[0]

    @operation("GET", "/records/export")
    async def export(
        self,
        format: Format = Format.CSV,
        table: Table | None = None,
        since: str | None = None,
        outcome: Outcome | None = None,
        text: str | None = None,
        service: str | None = None,
    ) -> Document:
        """The tasks that `find` finds as a file: JSON lines, a task a line, or a CSV table, of tasks if no other is named."""
        if format is Format.JSONL and table is not None:
            raise UsageError(f"table={table} is for CSV, and JSON lines hold all of a task; leave one of the two out")
        file = io.StringIO()
        query = _make_query(since, outcome, text, service, PAGE)
        await write(self._task_history, query, file, format, table or Table.TASKS)
        table_name = table or Table.TASKS
        return Document(
            content=file.getvalue().encode(), media_type=MEDIA_TYPES[format], name=f"{table_name}-{datetime.now():%Y%m%d-%H%M}.{format}"
        )


def _make_query(
    since: str | None,
    outcome: Outcome | None,
    text: str | None,
    service: str | None,
    limit: int,
    last_task: str | None = None,
    *,
    brief: bool = False,
) -> ReadRecords:
    return ReadRecords(
        since=moment(since, time.time()) if since else None,
        outcome=outcome,
        text=text or None,
        service=service or None,
        limit=limit,
        behind=last_task,
        brief=brief,
    )

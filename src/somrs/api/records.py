"""The records of ended tasks: search, reading and export."""

from __future__ import annotations

import io
import time
from datetime import datetime

from somrs.access.rights import Right
from somrs.api.context import Context
from somrs.client.export import PAGE, Format, Table, moment, write
from somrs.client.operations import Document, operation
from somrs.client.refusals import NotFound
from somrs.client.task_history import TaskHistory
from somrs.errors import UsageError
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.records import ReadRecords, Records, TaskRecord

_MEDIA_TYPES = {Format.JSONL: "application/jsonl", Format.CSV: "text/csv; charset=utf-8"}


class RecordService:
    def __init__(self, context: Context) -> None:
        self._client = context.client
        self._task_history = TaskHistory(context.client.records, context.client)

    @operation("GET", "/records", Right.SEE)
    async def find(
        self,
        since: str | None = None,
        outcome: Outcome | None = None,
        text: str | None = None,
        service: str | None = None,
        limit: int = 50,
        behind: str | None = None,
    ) -> Records:
        """List ended tasks, the latest first, without terms, events and messages.

        `since`: only tasks that ended at or after this date (2026-03-01), date and time (2026-03-01T14:30) or age (2h). `text`: only
        tasks whose goal contains this text. `service`: only tasks in which this service, or a service of this device, took part. If `more`
        is true in the result, there is a next page: pass the last task of this page as `behind`.
        """
        return await self._client.records(_make_query(since, outcome, text, service, limit, behind, brief=True))

    @operation("GET", "/records/{id}", Right.SEE)
    async def read(self, id: str) -> TaskRecord:
        """Read the record of an ended task: plan, work, terms, events, messages. `id` may be the beginning of the task's id."""
        records = (await self._client.records(ReadRecords(task=id, limit=2, brief=True))).records
        if len(records) != 1:
            problem = "several ids begin" if records else "no id begins"
            raise NotFound(f"among the tasks that are over, {problem} with {id}")
        return (await self._task_history.first(ReadRecords(task=records[0].task), 1))[0]

    @operation("GET", "/records/export", Right.SEE)
    async def export(
        self,
        format: Format = Format.CSV,
        table: Table | None = None,
        since: str | None = None,
        outcome: Outcome | None = None,
        text: str | None = None,
        service: str | None = None,
    ) -> Document:
        """Export the ended tasks that `GET /records` finds: as JSON lines, one task per line, or as a CSV table (by default, of tasks)."""
        if format is Format.JSONL and table is not None:
            raise UsageError(f"table={table} is for CSV; JSON lines contain the whole of each task. Leave out table, or choose CSV")
        file = io.StringIO()
        query = _make_query(since, outcome, text, service, PAGE)
        await write(self._task_history, query, file, format, table or Table.TASKS)
        table_name = table or Table.TASKS
        return Document(
            content=file.getvalue().encode(), media_type=_MEDIA_TYPES[format], name=f"{table_name}-{datetime.now():%Y%m%d-%H%M}.{format}"
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

"""Export of the records of ended tasks for other programs: as JSON lines, one record per line, or as CSV tables."""

from __future__ import annotations

import contextlib
import csv
import json
import re
import sys
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Mapping
from datetime import UTC, datetime
from enum import Enum, StrEnum
from pathlib import Path
from typing import IO

import msgspec
from msgspec import structs
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from somrs.client.addresses import Addresses
from somrs.client.task_history import TaskHistory, open_task_history
from somrs.errors import UsageError
from somrs.protocol.messages.event_kinds import EventKind
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.records import ReadRecords, Records, TaskRecord
from somrs.protocol.messages.task_views import ContractView, MessageView, TaskEvent, WorkView

PAGE = 100
"""Number of records requested at once; a page may have fewer if they are long."""

Cell = str | float | int | None
Row = Mapping[str, Cell]


class Table(StrEnum):
    """What a row of a CSV file is."""

    TASKS = "tasks"
    WORK = "work"
    CONTRACTS = "contracts"
    EVENTS = "events"
    MESSAGES = "messages"


class Format(StrEnum):
    """How records are written."""

    JSONL = "jsonl"
    CSV = "csv"


_TASK_COLUMNS = (
    "task", "effect", "outcome", "explanation", "reasons", "submitted_at", "ended_at", "seconds", "client", "precondition", "policy",
    "deadline", "priority", "steps", "work", "completed", "compensated", "stranded", "setbacks", "price", "currency",
)  # fmt: skip
TIMES = frozenset(("at", "began", "ended", "valid_until", "submitted_at", "ended_at"))
"""Columns with times, which are written as ISO 8601 in UTC."""

_PARTS: Mapping[Table, tuple[type[msgspec.Struct], Callable[[TaskRecord], Iterable[msgspec.Struct]]]] = {
    Table.WORK: (WorkView, lambda record: record.work),
    Table.CONTRACTS: (ContractView, lambda record: record.contracts),
    Table.EVENTS: (TaskEvent, lambda record: record.events),
    Table.MESSAGES: (MessageView, lambda record: record.messages),
}

_AGE = re.compile(r"(?P<count>\d+(?:\.\d+)?)\s*(?P<unit>[smhdw])")
_SECONDS = {"s": 1, "m": 60, "h": 3600, "d": 86_400, "w": 604_800}


def moment(text: str, now: float) -> float:
    """The time, in seconds since 1970, of a date, a date with a time, or an age (`2h`). Raises UsageError for other texts."""
    if (age := _AGE.fullmatch(text.strip())) is not None:
        return now - float(age["count"]) * _SECONDS[age["unit"]]
    try:
        return datetime.fromisoformat(text.strip()).timestamp()
    except (ValueError, OverflowError):
        raise UsageError(
            f"{text!r} is not a time; write a date (2026-03-01), a date with a time (2026-03-01T14:30), or an age (30m, 2h, 7d)"
        ) from None


async def export(
    output: Path | None, data: Path, format: Format, table: Table, query: ReadRecords | None = None, *, site: Addresses | None = None
) -> None:
    """Write the ended tasks that match the query (all, if None) to a file or to standard output, the latest first.

    They are those of a `site` that runs elsewhere, or else those in the data folder.
    """
    page_query = structs.replace(query or ReadRecords(), limit=PAGE)
    if output is not None and not output.parent.is_dir():
        raise UsageError(f"{output}: there is no folder {output.parent}; create it first")
    async with open_task_history(data, site) as archive:
        if output is None:
            await write(archive, page_query, sys.stdout, format, table)
            return
        # The file has another name until it is complete, so that an interrupted export is not mistaken for a complete one.
        unfinished = output.with_name(f"{output.name}.part")
        try:
            with unfinished.open("w", encoding="utf-8", newline="") as file, _bar(output) as bar:
                count = await write(archive, page_query, file, format, table, bar)
            unfinished.replace(output)
        finally:
            unfinished.unlink(missing_ok=True)
    print(f"{output}: {count} task{'s' if count != 1 else ''}")


ProgressCallback = Callable[[int, int | None], None]
"""Called with the number of records written, and the total if it is known."""


async def write(
    history: TaskHistory, query: ReadRecords, file: IO[str], format: Format, table: Table, on_progress: ProgressCallback | None = None
) -> int:
    """Write all records that match the query, and return their number. `query.limit` is the size of a page."""
    count, total = 0, None
    async for page in _lines(history, query, file, format, table):
        count, total = count + len(page.records), page.total if page.total is not None else total
        if on_progress is not None:
            on_progress(count, total)
    return count


async def _lines(history: TaskHistory, query: ReadRecords, file: IO[str], format: Format, table: Table) -> AsyncIterator[Records]:
    writer = csv.DictWriter(file, columns(table), lineterminator="\n") if format is Format.CSV else None
    if writer is not None:
        writer.writeheader()
    async for page in history.pages(query):
        for record in page.records:
            if writer is not None:
                writer.writerows(_rows(record, table))
            else:
                file.write(msgspec.json.encode(record).decode() + "\n")
        yield page


@contextlib.contextmanager
def _bar(output: Path) -> Iterator[ProgressCallback]:
    """A progress bar on standard error, if that is a terminal."""
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        bar = progress.add_task(output.name, total=None)
        yield lambda count, total: progress.update(bar, completed=count, total=total)


# CSV


def columns(table: Table) -> tuple[str, ...]:
    """The column names of a table."""
    if table is Table.TASKS:
        return _TASK_COLUMNS
    kind, _ = _PARTS[table]
    return ("task", *kind.__struct_fields__)


def _rows(record: TaskRecord, table: Table) -> Iterator[Row]:
    """The rows of a record in a table."""
    if table is Table.TASKS:
        yield _task(record)
        return
    _, parts = _PARTS[table]
    for part in parts(record):
        yield {"task": record.task, **{name: _cell(name, getattr(part, name)) for name in part.__struct_fields__}}


def _task(record: TaskRecord) -> Row:
    accepted = [contract for contract in record.contracts if contract.accepted and contract.price is not None]
    currencies = {contract.currency for contract in accepted}
    states = [work.state for work in record.work]
    values: dict[str, object] = {
        **{name: getattr(record, name) for name in _TASK_COLUMNS if name in TaskRecord.__struct_fields__},
        "seconds": round(record.ended_at - record.submitted_at, 3),
        "steps": len(record.steps),
        "work": len(record.work),
        "completed": states.count(State.COMPLETED),
        "compensated": states.count(State.COMPENSATED),
        "stranded": states.count(State.STRANDED),
        "setbacks": sum(event.kind is EventKind.SETBACK for event in record.events),
        # Prices in several currencies have no sum.
        "price": sum(contract.price or 0 for contract in accepted) if len(currencies) == 1 else 0 if not accepted else None,
        "currency": " ".join(sorted(currencies)),
    }
    return {name: _cell(name, value) for name, value in values.items()}


def _cell(name: str, value: object) -> Cell:
    if name in TIMES and isinstance(value, float | int):
        with contextlib.suppress(OverflowError, ValueError, OSError):  # terms may be valid beyond the last date that datetime can represent
            return datetime.fromtimestamp(value, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, dict | tuple | msgspec.Struct):
        return json.dumps(msgspec.to_builtins(value), ensure_ascii=False)
    return value if isinstance(value, str | float | int) else None

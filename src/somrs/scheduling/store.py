"""The Scheduler's file: the journal of its inputs, and the migration from the earlier format."""

from __future__ import annotations

import sqlite3
from dataclasses import replace
from pathlib import Path

import msgspec

from somrs.kernel.durability import JournalCodec, JournaledComponent
from somrs.protocol.messages.envelope import message_id
from somrs.protocol.messages.orders import Run, StandingOrder, Template
from somrs.protocol.messages.task_news import WatchTask
from somrs.scheduling.book import Book
from somrs.scheduling.component import SCHEMA, Scheduler
from somrs.scheduling.state import Located, Question, SchedulerState
from somrs.storage import journal_file
from somrs.storage.disk import Disk, execute
from somrs.storage.journal import Journal, Log

FILE = "orders.sqlite"
"""In the data folder."""


def orders_journal(path: Path, log: Log | None = None) -> Journal:
    """Open a Scheduler's file, or create it in an existing folder.

    Raises:
        UsageError: the file is damaged, is not a Scheduler's, or cannot be written.
    """
    return Journal(path, SCHEMA, disk=Disk(path, KIND, syncs=log is None), log=log)


def _journaled(db: sqlite3.Connection) -> None:
    """Migrate a file whose data is in tables to a journal that begins with a snapshot."""
    state = _state(db)
    execute(db, "DROP TABLE templates; DROP TABLE orders; DROP TABLE runs;" + journal_file.KIND.tables)
    journal_file.begin_with(db, JournaledComponent(Scheduler.restored(state), SCHEMA), JournalCodec(SCHEMA))


def _state(db: sqlite3.Connection) -> SchedulerState:
    """The state in the tables of the earlier format.

    The program sends the addresses of the other components at the start. The format has no requests: the state gets one for each open run,
    which reads the state of its task.
    """
    # All rows are read at once, since a cursor that stops at a damaged row would keep the file open.
    templates = db.execute("SELECT document FROM templates ORDER BY name").fetchall()
    orders = db.execute("SELECT document FROM orders ORDER BY rowid").fetchall()
    runs: dict[str, tuple[Run, ...]] = {}
    for order_id, document in db.execute("SELECT of, document FROM runs ORDER BY of, due").fetchall():
        runs[order_id] = (*runs.get(order_id, ()), msgspec.json.decode(document, type=Run))
    state = SchedulerState.new("", Located("", ""))
    state.book = Book(
        templates={template.name: template for template in (msgspec.json.decode(document, type=Template) for (document,) in templates)},
        orders={order.id: order for order in (msgspec.json.decode(document, type=StandingOrder) for (document,) in orders)},
        runs=runs,
    )
    state.questions = {
        message_id("question", order_id, run.due): Question(order=order_id, due=run.due, body=WatchTask(task=run.task or ""), until=0.0)
        for order_id, order_runs in runs.items()
        for run in order_runs
        if run.open
    }
    return state


KIND = replace(
    journal_file.KIND,
    owner="a Scheduler's",
    content="template or order",
    replaces={0x534F4D4F: _journaled},  # `SOMO` in ASCII
)

"""The Scheduler's file: the journal of its inputs, and what the file was like before."""

from __future__ import annotations

import sqlite3
from dataclasses import replace
from pathlib import Path

import msgspec

from somrs.kernel.durability import JournalCodec, JournaledComponent
from somrs.protocol.messages.clients import WatchTask
from somrs.protocol.messages.envelope import message_id
from somrs.protocol.messages.orders import Run, StandingOrder, Template
from somrs.scheduling.book import Book
from somrs.scheduling.component import SCHEMA, Scheduler
from somrs.scheduling.state import Located, Question, SchedulerState
from somrs.storage import journal
from somrs.storage.disk import Disk, execute
from somrs.storage.journal import Journal

FILE = "orders.sqlite"
"""In the data folder."""


def orders_journal(path: Path) -> Journal:
    """Open a Scheduler's file, or make it; its folder must be there. Raises UsageError for a file that is damaged, is somebody else's,
    or cannot be written."""
    return Journal(path, SCHEMA, disk=Disk(path, KIND))


def _journaled(db: sqlite3.Connection) -> None:
    """The book was in tables; it becomes a snapshot."""
    state = _state(db)
    execute(db, "DROP TABLE templates; DROP TABLE orders; DROP TABLE runs;" + journal.KIND.tables)
    journal.begin_with(db, JournaledComponent(Scheduler.restored(state), SCHEMA), JournalCodec(SCHEMA))


def _state(db: sqlite3.Connection) -> SchedulerState:
    """Where the other parts are, it hears when it is started. Questions were not kept: of each run that was open, the Task Manager is asked
    what became of it."""
    # All rows at once: a cursor that is left amid them, at one that is damaged, would go on holding the file.
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
    journal.KIND,
    owner="a Scheduler's",
    content="template or order",
    replaces={0x534F4D4F: _journaled},  # `SOMO` in ASCII
)

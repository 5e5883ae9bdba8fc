"""The Scheduler's file: templates and standing orders in JSON, with what came of each time at which one was due."""

from __future__ import annotations

import functools
import sqlite3
from pathlib import Path

import msgspec

from somrs.protocol.messages.orders import Run, StandingOrder, Template
from somrs.scheduling.book import MOST_RUNS, Book, BookChange, RunNoted
from somrs.storage.disk import Disk, Kind

FILE = "orders.sqlite"
"""In the data folder."""

_KIND = Kind(
    owner="an order book's",
    holds="template or order",
    rival="the Scheduler of another system",
    application=0x534F4D4F,  # `SOMO` in ASCII
    version=1,
    tables="""
    CREATE TABLE templates (name TEXT PRIMARY KEY, document TEXT NOT NULL);
    CREATE TABLE orders (id TEXT PRIMARY KEY, document TEXT NOT NULL);
    CREATE TABLE runs (of TEXT NOT NULL, due REAL NOT NULL, document TEXT NOT NULL, PRIMARY KEY (of, due));
    """,
)


class BookFile:
    """An open file. Raises UsageError for one that is damaged, is somebody else's, or cannot be written."""

    def __init__(self, path: Path) -> None:
        self.disk = Disk(path, _KIND)

    def load(self) -> Book:
        return self.disk.read(_read).result()

    def keep(self, entry: object) -> None:
        """Have an entry on disk, soon."""
        match entry:
            case BookChange():
                self.disk.write(functools.partial(_change, entry))
            case RunNoted():
                self.disk.write(functools.partial(_note, entry))
            case _:
                raise AssertionError(f"a Scheduler keeps its book, not {type(entry).__name__}")

    def close(self) -> None:
        """Write what is to be written, and close the file."""
        self.disk.close()


def _read(db: sqlite3.Connection) -> Book:
    templates = [msgspec.json.decode(document, type=Template) for (document,) in db.execute("SELECT document FROM templates ORDER BY name")]
    orders = [msgspec.json.decode(document, type=StandingOrder) for (document,) in db.execute("SELECT document FROM orders")]
    runs: dict[str, tuple[Run, ...]] = {}
    for of, document in db.execute("SELECT of, document FROM runs ORDER BY of, due"):
        runs[of] = (*runs.get(of, ()), msgspec.json.decode(document, type=Run))
    return Book(templates={one.name: one for one in templates}, orders={one.id: one for one in orders}, runs=runs)


def _change(change: BookChange, db: sqlite3.Connection) -> None:
    for name, template in change.templates.items():
        if template is None:
            db.execute("DELETE FROM templates WHERE name = ?", (name,))
        else:
            db.execute("INSERT OR REPLACE INTO templates VALUES (?, ?)", (name, msgspec.json.encode(template).decode()))
    for id, order in change.orders.items():
        if order is None:
            db.execute("DELETE FROM orders WHERE id = ?", (id,))
            db.execute("DELETE FROM runs WHERE of = ?", (id,))
        else:
            db.execute("INSERT OR REPLACE INTO orders VALUES (?, ?)", (id, msgspec.json.encode(order).decode()))


def _note(noted: RunNoted, db: sqlite3.Connection) -> None:
    db.execute("INSERT OR REPLACE INTO runs VALUES (?, ?, ?)", (noted.order, noted.run.due, msgspec.json.encode(noted.run).decode()))
    db.execute(
        "DELETE FROM runs WHERE of = ?1 AND due <= (SELECT due FROM runs WHERE of = ?1 ORDER BY due DESC LIMIT 1 OFFSET ?2)",
        (noted.order, MOST_RUNS),
    )

"""The histories on buses that a component's file has in common with them, and up to which entry.

A file may go on without its bus, and the bus without the file. Their entries have the same numbers then, and are others. The file notes
with which history on a bus it goes on, and, when it leaves it, the number of the last entry that both have.
"""

from __future__ import annotations

import sqlite3

_TABLE = "CREATE TABLE IF NOT EXISTS bus_histories (history TEXT PRIMARY KEY, number INTEGER)"
"""`number` is NULL as long as the file goes on with the history: both have all entries of the file."""


def read_common_numbers(db: sqlite3.Connection) -> dict[str, int | None]:
    """The number of the last common entry of each history; None for the one with which the file goes on."""
    if db.execute("SELECT 1 FROM sqlite_schema WHERE name = 'bus_histories'").fetchone() is None:
        return {}
    return dict(db.execute("SELECT history, number FROM bus_histories"))


def join_history(db: sqlite3.Connection, history: str, number: int) -> None:
    """Note that the file goes on with a history. `number`: that of its last entry, which it has in common with the one before."""
    db.execute(_TABLE)
    db.execute("UPDATE bus_histories SET number = ? WHERE number IS NULL AND history != ?", (number, history))
    db.execute("INSERT OR REPLACE INTO bus_histories VALUES (?, NULL)", (history,))


def leave_histories(db: sqlite3.Connection, number: int) -> None:
    """Note that the file goes on without a bus after the entry with this number."""
    if read_common_numbers(db):
        db.execute("UPDATE bus_histories SET number = ? WHERE number IS NULL", (number,))


def forget_histories(db: sqlite3.Connection) -> None:
    """Note that what the file has from here on has nothing to do with any history."""
    db.execute("DROP TABLE IF EXISTS bus_histories")

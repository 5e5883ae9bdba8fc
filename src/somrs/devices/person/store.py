"""The SQLite files of the data folder through which the programs of people and other programs talk (docs/decisions/0010)."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable
from pathlib import Path

from somrs.errors import UsageError


def open_store(path: Path, tables: Iterable[str], content: str) -> sqlite3.Connection:
    """Open the file, and make its folder and its tables if they are missing. Several programs may write.

    Raises:
        UsageError: the `content` cannot be kept there.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        database = sqlite3.connect(path, isolation_level=None, timeout=5.0)
        try:
            database.execute("PRAGMA journal_mode=WAL")
            for table in tables:
                database.execute(table)
        except sqlite3.Error:
            database.close()
            raise
    except (sqlite3.Error, OSError) as error:
        raise UsageError(f"{path}: the {content} cannot be kept here: {error}") from None
    return database

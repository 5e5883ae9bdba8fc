"""Whether another process has a database open."""

from __future__ import annotations

import contextlib
import sqlite3
from pathlib import Path


def is_locked(error: sqlite3.Error) -> bool:
    """Whether another process has the file. Errors that do not come from SQLite itself have no name."""
    return getattr(error, "sqlite_errorname", "") in ("SQLITE_BUSY", "SQLITE_LOCKED")


def is_in_use(path: Path) -> bool:
    """Whether another process has opened the database: it holds the lock as long as it runs. False if there is no such file."""
    try:
        with contextlib.closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True, timeout=0)) as db:
            db.execute("SELECT count(*) FROM sqlite_schema")
    except sqlite3.OperationalError as error:
        return is_locked(error)
    except sqlite3.DatabaseError:
        pass  # no database; whoever opens it explains that
    return False

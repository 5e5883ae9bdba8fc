"""Whether a database is in use: a running component holds its lock."""

from __future__ import annotations

import contextlib
import sqlite3
from pathlib import Path

from somrs.storage.locking import is_in_use


def test_a_database_is_in_use_while_somebody_holds_its_lock(tmp_path: Path) -> None:
    path = tmp_path / "repository.sqlite"
    assert not is_in_use(path)
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as db:
        for pragma in ("locking_mode=EXCLUSIVE", "journal_mode=WAL"):
            db.execute(f"PRAGMA {pragma}")
        db.execute("CREATE TABLE entries (number)")
        assert is_in_use(path)
    assert not is_in_use(path)


def test_what_is_no_database_is_not_in_use(tmp_path: Path) -> None:
    path = tmp_path / "repository.sqlite"
    path.write_text("this is no database, and longer than the head of one " * 10)
    assert not is_in_use(path)
    assert not is_in_use(tmp_path / "missing" / "repository.sqlite")

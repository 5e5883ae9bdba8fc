"""A journal in one SQLite file, for contestants without their own: one thread writes all waiting entries in one transaction."""

from __future__ import annotations

import asyncio
import queue
import sqlite3
import threading
from pathlib import Path

Waiting = tuple[bytes, asyncio.Future[None]]


class Journal:
    """A write-ahead log with `synchronous=FULL`. It belongs to the event loop in which it was made."""

    def __init__(self, path: Path) -> None:
        self._loop = asyncio.get_running_loop()
        self._waiting: queue.SimpleQueue[Waiting | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._write, args=(path,), daemon=True)
        self._thread.start()

    def append(self, entry: bytes) -> asyncio.Future[None]:
        """Append an entry. The future is done when the entry is on disk."""
        written: asyncio.Future[None] = self._loop.create_future()
        self._waiting.put((entry, written))
        return written

    def close(self) -> None:
        self._waiting.put(None)
        self._thread.join()

    def _write(self, path: Path) -> None:
        db = sqlite3.connect(path, isolation_level=None)
        for statement in (
            "PRAGMA journal_mode=WAL",
            "PRAGMA synchronous=FULL",
            "CREATE TABLE IF NOT EXISTS entries (number INTEGER PRIMARY KEY, entry BLOB)",
        ):
            db.execute(statement)
        while (first := self._waiting.get()) is not None:
            batch, is_draining = [first], True
            while is_draining:
                try:
                    waiting_entry = self._waiting.get_nowait()
                except queue.Empty:
                    break
                if waiting_entry is None:
                    self._waiting.put(None)
                    break
                batch.append(waiting_entry)
            db.execute("BEGIN")
            db.executemany("INSERT INTO entries (entry) VALUES (?)", [(entry,) for entry, _ in batch])
            db.execute("COMMIT")
            self._loop.call_soon_threadsafe(_written, [future for _, future in batch])
        db.close()


def _written(futures: list[asyncio.Future[None]]) -> None:
    for future in futures:
        if not future.done():
            future.set_result(None)

"""The Service Registry's file: who offers what, and until when. It is small, and the latest of each provider counts."""

from __future__ import annotations

import functools
import sqlite3
from pathlib import Path

import msgspec

from somrs.registry.entries import Listed
from somrs.storage.disk import Disk, Kind

_KIND = Kind(
    owner="a Service Registry's",
    holds="list of services",
    rival="another process",
    application=0x534F4D53,  # `SOMS` in ASCII
    version=1,
    tables="CREATE TABLE listed (provider TEXT PRIMARY KEY, entry BLOB NOT NULL);",
)


class Listing:
    """An open file. Raises UsageError for one that is damaged, is somebody else's, or cannot be written."""

    def __init__(self, path: Path) -> None:
        self.disk = Disk(path, _KIND)

    def load(self) -> list[Listed]:
        """What is listed; some of it may have run out since."""

        def read(db: sqlite3.Connection) -> list[Listed]:
            return [msgspec.msgpack.decode(entry, type=Listed) for (entry,) in db.execute("SELECT entry FROM listed ORDER BY provider")]

        return self.disk.read(read).result()

    def keep(self, entry: object) -> None:
        """Have an entry on disk, soon."""
        assert isinstance(entry, Listed), f"a Registry keeps what is listed, not {type(entry).__name__}"
        self.disk.write(functools.partial(_put, entry))

    def close(self) -> None:
        """Write what is to be written, and close the file."""
        self.disk.close()


def _put(entry: Listed, db: sqlite3.Connection) -> None:
    if entry.offers:
        db.execute("INSERT OR REPLACE INTO listed VALUES (?, ?)", (entry.provider, msgspec.msgpack.encode(entry)))
    else:
        db.execute("DELETE FROM listed WHERE provider = ?", (entry.provider,))

"""The high-water mark of a database: the numbers of the last entries that it has had, in a file beside it.

SQLite drops what follows a damaged page of its write-ahead log, or a log that was removed, and says nothing. The mark shows that something
is missing. It is written after each commit and never synchronised: after a power failure it may be behind the database, and is never ahead.
"""

from __future__ import annotations

import contextlib
import os
import zlib
from pathlib import Path

import msgspec

_NUMBERS = msgspec.msgpack.Decoder(tuple[int, dict[str, int]])
_SUM_SIZE = 4
_SIZE_SIZE = 4


class HighWaterMark:
    """The mark beside a database. It only counts for the file for which it was made: a copy that is put in its place has no mark."""

    def __init__(self, database: Path) -> None:
        self.path = database.with_name(database.name + "-mark")
        self._database = database
        self._inode = 0
        self._file: int | None = None
        self.numbers: dict[str, int] = {}
        """The number of the last entry of each component in the database."""

    def open(self) -> None:
        """Read the mark. Call it before the database is created: a new database has no mark."""
        try:
            stat = self._database.stat()
        except OSError:
            stat = None
        if stat is None or stat.st_size == 0:
            self.path.unlink(missing_ok=True)
            return
        inode, self.numbers = self._read()
        if inode != stat.st_ino:
            self.numbers = {}

    def _read(self) -> tuple[int, dict[str, int]]:
        try:
            document = self.path.read_bytes()
            size = int.from_bytes(document[:_SIZE_SIZE], "big")
            content = document[_SIZE_SIZE : _SIZE_SIZE + size]
            if document[_SIZE_SIZE + size :][:_SUM_SIZE] == zlib.crc32(content).to_bytes(_SUM_SIZE, "big"):
                return _NUMBERS.decode(content)
        except (OSError, msgspec.MsgspecError):
            pass
        return 0, {}

    def write(self, numbers: dict[str, int]) -> None:
        """Set the mark. A full disk leaves the one before, which is behind."""
        self.numbers = numbers
        with contextlib.suppress(OSError):
            if self._file is None:
                self._inode = self._database.stat().st_ino
                self._file = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o600)
            content = msgspec.msgpack.encode((self._inode, numbers))
            checksum = zlib.crc32(content).to_bytes(_SUM_SIZE, "big")
            os.pwrite(self._file, len(content).to_bytes(_SIZE_SIZE, "big") + content + checksum, 0)

    def close(self) -> None:
        if self._file is not None:
            os.close(self._file)
            self._file = None

"""Follows the message file of a running Task Manager; a read takes microseconds."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import msgspec

from somrs.client.trace import Line


class Tail:
    """Reads the lines that are appended after its creation."""

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_RDONLY)
        os.lseek(self._file, 0, os.SEEK_END)
        self._rest = b""

    def new(self) -> Iterator[Line]:
        """Yield the lines that were appended since the last call."""
        while read := os.read(self._file, 1 << 16):
            *lines, self._rest = (self._rest + read).split(b"\n")
            for line in lines:
                yield msgspec.json.decode(line, type=Line)

    def close(self) -> None:
        os.close(self._file)

"""Follows the message files of a running Task Manager; a read takes microseconds."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from somrs.client.trace import Line


class Tail:
    """Reads the lines that are appended after its creation."""

    def __init__(self, paths: Sequence[Path]) -> None:
        """`paths`: a file for each process that may be the Task Manager."""
        self._rests = {os.open(path, os.O_RDONLY): b"" for path in paths}
        for file in self._rests:
            os.lseek(file, 0, os.SEEK_END)

    def new(self) -> Iterator[Line]:
        """Yield the lines that were appended since the last call."""
        for file in self._rests:
            while read := os.read(file, 1 << 16):
                *lines, self._rests[file] = (self._rests[file] + read).split(b"\n")
                for line in lines:
                    yield msgspec.json.decode(line, type=Line)

    def close(self) -> None:
        for file in self._rests:
            os.close(file)

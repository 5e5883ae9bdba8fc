"""Files to which lines are added for ever. When such a file is full, its content goes to a file beside it, in place of an earlier one."""

from __future__ import annotations

import os
import shutil
from pathlib import Path


def older_file(path: Path) -> Path:
    """The file with the lines before those of a log."""
    return path.with_name(f"{path.name}.1")


def empty_if_full(path: Path, most_bytes: int) -> bool:
    """Move the content of a log that other processes have open for appending to its older file, if it is full. Returns whether it was.

    The writers go on in the empty file. Lines that are written at this moment may be lost.
    """
    try:
        if path.stat().st_size < most_bytes:
            return False
        shutil.copyfile(path, older_file(path))
        os.truncate(path, 0)
    except OSError:  # no such file, or no room on the disk: it is tried again
        return False
    return True


class LogFile:
    """A log that this process writes, line by line and unbuffered, so that other programs can read it at once."""

    def __init__(self, path: Path, most_bytes: int) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._path, self._most_bytes = path, most_bytes
        self._file = path.open("ab", buffering=0)

    def write_line(self, line: bytes) -> None:
        if self._file.tell() + len(line) > self._most_bytes and self._file.tell():
            self._file.close()
            self._path.replace(older_file(self._path))
            self._file = self._path.open("ab", buffering=0)
        self._file.write(line + b"\n")

    def close(self) -> None:
        self._file.close()

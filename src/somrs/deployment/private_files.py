"""Files that only the user who runs a system may read: its data folder has keys, journals and what people wrote."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from somrs.client.addresses import SYSTEM_FILE

OTHERS = 0o077
"""What a file would allow others."""


def keep_files_private() -> None:
    """Let what this process makes from now on, and its child processes, be for its own user alone."""
    os.umask(OTHERS)


def make_private(data: Path) -> None:
    """Make a data folder that only its user may enter, or shut one that others may: of an earlier version, or empty."""
    data.mkdir(mode=0o777 & ~OTHERS, parents=True, exist_ok=True)
    details = data.stat()
    is_own = details.st_uid == os.geteuid() and ((data / SYSTEM_FILE).exists() or not any(data.iterdir()))
    if is_own and details.st_mode & OTHERS:
        data.chmod(details.st_mode & 0o7777 & ~OTHERS)


def discard(data: Path, keep: Sequence[Path] = ()) -> None:
    """Delete what a system has kept in its data folder, but for the files in `keep`."""
    kept = {file.resolve() for file in keep}
    for entry in data.iterdir() if data.exists() else ():
        if entry.resolve() in kept:
            continue
        if entry.is_dir():
            shutil.rmtree(entry)
        else:
            entry.unlink()

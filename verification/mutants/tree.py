"""A copy of the project in which one file is another one.

Whole and in a folder of its own: so processes that tests start have the mutant, too, tests that read the source find it, and whoever
works on the project meanwhile disturbs nothing.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[2]

SHARED_FOLDER = "shared"
"""What lies beside the project, and tests use where it is."""

COMPILED = "__pycache__"
TIME_SHIFT = 100_000
"""Seconds by which a changed file is newer: Python takes a compiled file for that of a source of the same size and second."""


def files(root: Path = ROOT) -> list[str]:
    """Those of the project, also such as are not committed yet."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    output = subprocess.run(command, cwd=root, capture_output=True, check=True).stdout.decode()
    return sorted({name for name in output.split("\0") if name and (root / name).is_file()})


class Tree:
    """The copy."""

    def __init__(self, root: Path, project: Path = ROOT) -> None:
        self.root = root
        originals = {root / name: project / name for name in files(project)}
        for place in [*root.rglob("*")] if root.exists() else ():
            if place.is_file() and place not in originals and place.parent.name != COMPILED:
                place.unlink()
        for place, original in originals.items():
            if not place.exists() or _file_stamp(place) != _file_stamp(original):
                place.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(original, place)
        shared = root.parent / SHARED_FOLDER
        if (project.parent / SHARED_FOLDER).is_dir() and not shared.exists():
            shared.symlink_to(project.parent / SHARED_FOLDER)

    @property
    def environment(self) -> dict[str, str]:
        """Of a process in which the copy is the project."""
        path = os.pathsep.join([str(self.root / "src"), str(self.root)])
        return {**os.environ, "PYTHONPATH": path, "NO_SHRINKING": "1"}

    @contextmanager
    def changed(self, file: str, source: bytes) -> Iterator[None]:
        """The file is this one meanwhile."""
        place = self.root / file
        original, stat = place.read_bytes(), place.stat()
        _forget_compiled(place)
        try:
            place.write_bytes(source)
            os.utime(place, (stat.st_atime, stat.st_mtime + TIME_SHIFT))
            yield
        finally:
            place.write_bytes(original)
            os.utime(place, ns=(stat.st_atime_ns, stat.st_mtime_ns))
            _forget_compiled(place)


def _file_stamp(place: Path) -> tuple[int, int]:
    return place.stat().st_size, place.stat().st_mtime_ns


def _forget_compiled(place: Path) -> None:
    """One mutant is not to be taken for another of the same size."""
    for compiled in (place.parent / COMPILED).glob(f"{place.stem}.*"):
        compiled.unlink()


def digest(paths: list[Path]) -> str:
    """Says whether anything in these files is another than it was."""
    hasher = hashlib.sha256()
    for path in paths:
        hasher.update(f"{path.name} {path.stat().st_size}\n".encode() + path.read_bytes())
    return hasher.hexdigest()[:16]

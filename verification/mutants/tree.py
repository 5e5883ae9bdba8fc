"""A copy of the project with one changed file.

It is a complete copy in its own folder: processes that tests start contain the mutant, tests that read the source find it, and the project
can be edited at the same time.
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
"""A folder beside the project that tests use."""

COMPILED = "__pycache__"
TIME_SHIFT = 100_000
"""The time added to a changed file's date, in seconds: Python uses a compiled file for any source with the same size and time."""


def files(root: Path = ROOT) -> list[str]:
    """Return the files of the project, including those that are not committed yet."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    output = subprocess.run(command, cwd=root, capture_output=True, check=True).stdout.decode()
    return sorted({name for name in output.split("\0") if name and (root / name).is_file()})


class Tree:
    """The copy of the project."""

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
        """The environment of a process that uses the copy as the project."""
        path = os.pathsep.join([str(self.root / "src"), str(self.root)])
        return {**os.environ, "PYTHONPATH": path, "NO_SHRINKING": "1"}

    @contextmanager
    def changed(self, file: str, source: bytes) -> Iterator[None]:
        """A context in which the file has this content."""
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
    """Delete compiled files, so that one mutant is not taken for another of the same size."""
    for compiled in (place.parent / COMPILED).glob(f"{place.stem}.*"):
        compiled.unlink()


def digest(paths: list[Path]) -> str:
    """Return a digest that changes with the names or contents of the files."""
    hasher = hashlib.sha256()
    for path in paths:
        hasher.update(f"{path.name} {path.stat().st_size}\n".encode() + path.read_bytes())
    return hasher.hexdigest()[:16]

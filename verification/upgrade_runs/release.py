"""Builds the last release in a folder."""

from __future__ import annotations

import io
import subprocess
import zipfile
from pathlib import Path

from somrs.errors import UsageError

ROOT = Path(__file__).parents[2]
RELEASE_FILE = Path(__file__).with_name("release")
"""The version of the last release, and its commit. A clone may lack tags, but has the commits."""

PARTS = ("src", "verification", "examples")


def release_name() -> tuple[str, str]:
    """Return the version and the commit of the last release."""
    version, commit = RELEASE_FILE.read_text(encoding="ascii").split()
    return version, commit


def build_release(folder: Path) -> Path:
    """Build the release's tree below the folder, unless it exists. Raises UsageError if the clone does not have the commit."""
    version, commit = release_name()
    tree = folder / f"{version}-{commit[:10]}"
    if (tree / ".complete").exists():
        return tree
    completed = subprocess.run(["git", "-C", str(ROOT), "archive", "--format=zip", commit, *PARTS], capture_output=True, check=False)
    if completed.returncode:
        reason = completed.stderr.decode(errors="replace").strip()
        raise UsageError(f"release {version} cannot be built from its commit {commit}: {reason}; use a clone with its history")
    tree.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(io.BytesIO(completed.stdout)) as archive:
        archive.extractall(tree)
    (tree / ".complete").touch()
    return tree

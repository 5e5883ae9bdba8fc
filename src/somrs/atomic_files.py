"""Small files that are replaced in one step: whoever reads one finds all of the old content, or all of the new one, also when its writer
was killed in between."""

from __future__ import annotations

from pathlib import Path


def write_atomically(file: Path, content: bytes) -> None:
    """Replace a file, whose folder exists. Only one program at a time may write it. Raises OSError.

    It need not survive a loss of power right after this.
    """
    new_file = file.with_name(f"{file.name}.new")
    new_file.write_bytes(content)
    new_file.replace(file)

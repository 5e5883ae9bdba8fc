"""A record of what is said on the wires of adapters, for people who look for a fault, and for demonstrations.

It is made if the environment variable `SOMRS_WIRES` names a folder: a file for each wire, with a line of JSON for each message.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path

VARIABLE = "SOMRS_WIRES"


@contextlib.contextmanager
def recorded_wires(folder: Path) -> Iterator[None]:
    """Have the adapters whose programs are started meanwhile record what is said on their wires, in a folder."""
    os.environ[VARIABLE] = str(folder.resolve())
    try:
        yield
    finally:
        os.environ.pop(VARIABLE, None)


class WireRecord:
    """The record of one wire, such as `arcos-Robot1`; it writes nothing unless a folder is named. `note`: a message, `>` to the robot
    or thing, or `<` from it."""

    def __init__(self, wire: str) -> None:
        folder = os.environ.get(VARIABLE)
        self._file = Path(folder) / f"{wire}.jsonl" if folder else None
        if self._file is not None:
            self._file.parent.mkdir(parents=True, exist_ok=True)

    def note(self, direction: str, text: str | bytes, topic: str | None = None) -> None:
        if self._file is None:
            return
        message = text.hex(" ") if isinstance(text, bytes) else text
        entry = {"at": round(time.time(), 3), "direction": direction, **({"topic": topic} if topic else {}), "message": message}
        with self._file.open("a", encoding="utf-8") as file:
            file.write(json.dumps(entry, ensure_ascii=False) + "\n")

"""What happened to the programs of a running system: which ended or hung, and were started again."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path

import msgspec

from somrs.atomic_files import write_atomically

FILE = "incidents.json"
"""In the data folder."""

MOST_INCIDENTS = 20
"""The latest so many are kept."""


class Incident(msgspec.Struct, frozen=True, kw_only=True):
    """What happened, for people, and when, in seconds since 1970."""

    at: float
    text: str


_INCIDENTS = msgspec.json.Decoder(tuple[Incident, ...])


def read_incidents(data: Path) -> tuple[Incident, ...]:
    """The latest incidents of the system with this data folder, the oldest first."""
    try:
        return _INCIDENTS.decode((data / FILE).read_bytes())
    except (OSError, msgspec.MsgspecError):
        return ()


def add_incident(data: Path, text: str) -> None:
    incidents = (*read_incidents(data), Incident(at=time.time(), text=text))[-MOST_INCIDENTS:]
    with contextlib.suppress(OSError):  # the disk is full
        write_atomically(data / FILE, msgspec.json.encode(incidents))

"""Whether the event loop of a program turns. What hangs is found by what it does, and never by how long it takes.

A program whose loop turns counts (`Heartbeat`). One that does not count may be slow, wait for a processor or for its disk, and is left
alone. It hangs if its main thread has used much processor time meanwhile, or if it was stopped by a signal. Linux says both in `/proc`;
where there is none, nothing is found.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

MOST_CPU = 120.0
"""Seconds of processor time that the main thread may use in one turn of its loop."""

STOPPED_LOOKS = 3
"""So many times in a row a process is seen stopped before it counts: a terminal stops and continues several one after the other."""

BEAT_VARIABLE = "SOMRS_BEAT"
"""The environment variable with the file in which a program counts."""

_TICKS = os.sysconf("SC_CLK_TCK")


class Heartbeat:
    """Counts, in the file that the environment names, the turns of the event loop that calls `beat`."""

    def __init__(self) -> None:
        path = os.environ.get(BEAT_VARIABLE)
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT, 0o600) if path else None
        self._count = 0

    def beat(self) -> None:
        if self._file is not None:
            self._count += 1
            with suppress(OSError):  # the disk is full
                os.pwrite(self._file, self._count.to_bytes(8, "big"), 0)


def read_beat(path: Path) -> int | None:
    """The count of a program; None if it is not ready yet."""
    try:
        return int.from_bytes(path.read_bytes(), "big") or None
    except OSError:
        return None


class Activity(NamedTuple):
    """The state of a thread, as the letter in `/proc`, and the processor time that it has used, in seconds."""

    state: str
    cpu: float


def read_activity(pid: int, thread: str = "") -> Activity | None:
    """What a thread of a process does, by default the main one; None if that cannot be seen."""
    try:
        fields = Path(f"/proc/{pid}/task/{thread or pid}/stat").read_text().rpartition(")")[2].split()
        return Activity(fields[0], (int(fields[11]) + int(fields[12])) / _TICKS)
    except (OSError, ValueError, IndexError):
        return None


def is_stopped(pid: int) -> bool:
    """Whether all threads of a process stand still after SIGSTOP. Also if that cannot be seen."""
    states = (activity.state for task in Path(f"/proc/{pid}/task").glob("*") if (activity := read_activity(pid, task.name)) is not None)
    return all(state == "T" for state in states)


class LoopWatch:
    """Watches one process, from one look to the next."""

    def __init__(self) -> None:
        self._last_beat: int | None = None
        self._cpu_at_beat = 0.0
        self._stopped_count = 0

    def look(self, beat: int | None, activity: Activity | None) -> str | None:
        """Why the process hangs; None if it does not."""
        if beat is None or activity is None:
            return None
        if beat != self._last_beat:
            self._last_beat, self._cpu_at_beat = beat, activity.cpu
        self._stopped_count = self._stopped_count + 1 if activity.state == "T" else 0
        if self._stopped_count >= STOPPED_LOOKS:
            return "it was stopped by a signal (SIGSTOP)"
        if (turn_cpu := activity.cpu - self._cpu_at_beat) >= MOST_CPU:
            return f"its event loop has not turned for {turn_cpu:.0f} s of processor time"
        return None

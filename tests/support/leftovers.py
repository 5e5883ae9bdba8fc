"""Processes that a test left: found, ended and told. On Linux only; elsewhere nobody looks."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import time
from pathlib import Path

SET_CHILD_SUBREAPER = 36
"""Of prctl(2): whoever loses its parent becomes a child of this process, and is so found."""

WARM = "warm launchers of tests"

KEPT = ("multiprocessing.resource_tracker", "multiprocessing.forkserver", "tests.support.warm", WARM)
"""Python, and tests, start them once and end them with themselves."""

PATIENCE = 10.0
"""Seconds that a process has which was told to end and was not waited for."""


def adopt_orphans() -> None:
    if Path("/proc/self/task").is_dir():
        ctypes.CDLL(None).prctl(SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def processes() -> dict[int, str]:
    """The children of this process that run, with their command lines; those of no parent any more are among them, and so are those of
    a child that is kept."""
    found: dict[int, str] = {}
    for pid, line in _children("self").items():
        if any(kept in line for kept in KEPT):
            found |= _children(str(pid))
        else:
            found[pid] = line
    return found


def _children(of: str) -> dict[int, str]:
    found: dict[int, str] = {}
    with contextlib.suppress(OSError):  # it just ended, or there is no such folder
        for task in os.listdir(f"/proc/{of}/task"):
            with contextlib.suppress(OSError):  # a thread that just ended
                found |= {pid: _line(pid) for pid in map(int, _read(f"/proc/{of}/task/{task}/children").split())}
    return {pid: line for pid, line in found.items() if line}


def _line(pid: int) -> str:
    """Empty when it has ended, though nobody asked yet how."""
    with contextlib.suppress(OSError):
        return _read(f"/proc/{pid}/cmdline").replace(b"\0", b" ").decode(errors="replace").strip()
    return ""


def _read(path: str) -> bytes:
    with open(path, "rb", buffering=0) as file:
        return file.read()


def end(before: dict[int, str]) -> list[str]:
    """Kill what was not there before, with all that it started, and say what it was."""
    until = time.monotonic() + PATIENCE
    while (left := _new(before)) and time.monotonic() < until:
        time.sleep(0.02)
    told = list(left.values())
    while left:  # whose parent is killed comes up next
        for pid in left:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(0.02)
        left = _new(before)
    return told


def _new(before: dict[int, str]) -> dict[int, str]:
    return {pid: line for pid, line in processes().items() if pid not in before}

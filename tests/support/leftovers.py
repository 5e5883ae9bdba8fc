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

EXEMPT = ("multiprocessing.resource_tracker", "multiprocessing.forkserver", "tests.support.warm", WARM)
"""Python, and tests, start them once and end them with themselves."""

PATIENCE = 60.0
"""Seconds that a process has which was told to end and was not waited for."""


def adopt_orphans() -> None:
    if Path("/proc/self/task").is_dir():
        ctypes.CDLL(None).prctl(SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def processes() -> dict[int, str]:
    """The children of this process that run, with their command lines; those of no parent any more are among them, and so are those of
    a child that is kept."""
    running: dict[int, str] = {}
    for pid, line in _children("self").items():
        if any(exempt in line for exempt in EXEMPT):
            running |= _children(str(pid))
        else:
            running[pid] = line
    return running


def _children(parent: str) -> dict[int, str]:
    children: dict[int, str] = {}
    with contextlib.suppress(OSError):  # it just ended, or there is no such folder
        for task in os.listdir(f"/proc/{parent}/task"):
            with contextlib.suppress(OSError):  # a thread that just ended
                children |= {pid: _line(pid) for pid in map(int, _read(f"/proc/{parent}/task/{task}/children").split())}
    return {pid: line for pid, line in children.items() if line}


def _line(pid: int) -> str:
    """Empty when it has ended, though nobody asked yet how."""
    with contextlib.suppress(OSError):
        return _read(f"/proc/{pid}/cmdline").replace(b"\0", b" ").decode(errors="replace").strip()
    return ""


def _read(path: str) -> bytes:
    with open(path, "rb", buffering=0) as file:
        return file.read()


def end(processes_before: dict[int, str]) -> list[str]:
    """Kill what was not there before, with all that it started, and say what it was."""
    deadline = time.monotonic() + PATIENCE
    while (remaining := _new(processes_before)) and time.monotonic() < deadline:
        time.sleep(0.02)
    command_lines = list(remaining.values())
    while remaining:  # whose parent is killed comes up next
        for pid in remaining:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(0.02)
        remaining = _new(processes_before)
    return command_lines


def _new(processes_before: dict[int, str]) -> dict[int, str]:
    return {pid: line for pid, line in processes().items() if pid not in processes_before}

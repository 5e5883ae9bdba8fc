"""Finds, ends and reports processes that a test left. Works on Linux only; elsewhere it finds none."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import time
from pathlib import Path

SET_CHILD_SUBREAPER = 36
"""The option of prctl(2) by which orphans become children of this process, so that it finds them."""

WARM = "warm launchers of tests"

EXEMPT = ("multiprocessing.resource_tracker", "multiprocessing.forkserver", "tests.support.warm", WARM)
"""Processes that Python or tests start once, and that end with them."""

PATIENCE = 60.0
"""Seconds that a process has which was told to end and was not waited for."""


def adopt_orphans() -> None:
    if Path("/proc/self/task").is_dir():
        ctypes.CDLL(None).prctl(SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def processes() -> dict[int, str]:
    """Return the running children of this process with their command lines, including adopted orphans and the children of exempt
    processes."""
    running: dict[int, str] = {}
    for pid, line in _children("self").items():
        if any(exempt in line for exempt in EXEMPT):
            running |= _children(str(pid))
        else:
            running[pid] = line
    return running


def _children(parent: str) -> dict[int, str]:
    children: dict[int, str] = {}
    with contextlib.suppress(OSError):  # the process has just ended, or the system has no /proc
        for task in os.listdir(f"/proc/{parent}/task"):
            with contextlib.suppress(OSError):  # a thread that just ended
                children |= {pid: _line(pid) for pid in map(int, _read(f"/proc/{parent}/task/{task}/children").split())}
    return {pid: line for pid, line in children.items() if line}


def _line(pid: int) -> str:
    """Return the command line; it is empty for a process that has ended and was not waited for."""
    with contextlib.suppress(OSError):
        return _read(f"/proc/{pid}/cmdline").replace(b"\0", b" ").decode(errors="replace").strip()
    return ""


def _read(path: str) -> bytes:
    with open(path, "rb", buffering=0) as file:
        return file.read()


def end(processes_before: dict[int, str]) -> list[str]:
    """Kill the processes that did not exist before, with their children, and return their command lines."""
    deadline = time.monotonic() + PATIENCE
    while (remaining := _new(processes_before)) and time.monotonic() < deadline:
        time.sleep(0.02)
    command_lines = list(remaining.values())
    while remaining:  # children of a killed process are found in the next round
        for pid in remaining:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(0.02)
        remaining = _new(processes_before)
    return command_lines


def _new(processes_before: dict[int, str]) -> dict[int, str]:
    return {pid: line for pid, line in processes().items() if pid not in processes_before}

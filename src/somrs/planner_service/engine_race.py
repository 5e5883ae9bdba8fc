"""Runs engines in parallel, each in a process of its own. The first result counts; the other engines are killed.

Each engine has limits of time and memory. When an engine ends without a result, or has used its share of the time while
others wait, the next waiting engine starts.
"""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from somrs.errors import RemoteError

MAX_RUNNING = 2
"""The maximum number of engines that run in parallel, if there are as many processors."""
MEMORY = 4 * 1024**3
"""The memory limit of an engine, in bytes."""
MOST_WAIT = 0.05
"""The maximum interval between two polls of the engines, in seconds."""
GRACE = 5
"""Seconds of processor time beyond an engine's time limit after which the kernel kills it, in case its parent process has ended."""

KILLED = {-signal.SIGKILL, -signal.SIGTERM, -signal.SIGSEGV, -signal.SIGBUS}
"""Exit codes of a process that was killed from outside, or by a fault of its own that may not occur again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Entrant:
    """An engine that takes part. `command` makes its command line from the path of the task file and the path to write the plan to."""

    name: str
    command: Callable[[Path, Path], Sequence[str]]
    share: float = 1.0
    """The share of the time limit that it may take, if other engines wait."""
    proves: frozenset[int] = frozenset()
    """The exit codes that mean that there is no plan."""
    starts: int = 2
    """The maximum number of starts, if signals from outside kill it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineResult:
    """The result of an engine: the names of the plan's operators, or None if there is no plan."""

    engine_name: str
    operators: tuple[str, ...] | None


class _Running:
    """A running engine: one process, in its parent's process group, so that both are killed together."""

    def __init__(self, entrant: Entrant, number: int, task: Path, seconds: float, memory: int) -> None:
        self.entrant = entrant
        self.plan_path = task.with_name(f"plan-{number}")
        self._output_path = task.with_name(f"said-{number}")
        self.started_at = time.monotonic()
        with task.open("rb") as task_file, self._output_path.open("wb") as output_file:
            self.process = subprocess.Popen(entrant.command(task, self.plan_path), stdin=task_file, stdout=output_file, stderr=output_file)
        if sys.platform == "linux":
            with contextlib.suppress(ProcessLookupError):
                for kind, limit in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, round(seconds) + GRACE)):
                    resource.prlimit(self.process.pid, kind, (limit, limit))

    def end(self) -> None:
        self.process.kill()
        self.process.wait()

    def read_result(self) -> EngineResult | None:
        """The result of an engine that has ended; None if it found neither a plan nor a proof that there is none."""
        if self.plan_path.exists():
            lines = self.plan_path.read_text(encoding="ascii").splitlines()
            return EngineResult(
                engine_name=self.entrant.name, operators=tuple(line.strip("()") for line in lines if not line.startswith(";"))
            )
        return EngineResult(engine_name=self.entrant.name, operators=None) if self.process.returncode in self.entrant.proves else None

    def describe_failure(self) -> str:
        last_lines = self._output_path.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-1:]
        return f"{self.entrant.name} ended with code {self.process.returncode}" + (f" ({last_lines[0][-200:]})" if last_lines else "")


@contextmanager
def _all_ended() -> Iterator[list[_Running]]:
    running: list[_Running] = []
    try:
        yield running
    finally:
        for engine in running:
            engine.end()


def race(entrants: Sequence[Entrant], task: Path, seconds: float, *, max_running: int | None = None, memory: int = MEMORY) -> EngineResult:
    """The first result for the task in the file, within `seconds`. Raises RemoteError when there is none in time. Leaves no engine
    running."""
    slots = max_running or max(1, min(MAX_RUNNING, os.cpu_count() or 1))
    deadline = time.monotonic() + seconds
    waiting, failures = list(entrants), list[str]()
    with _all_ended() as running:
        wait = 0.001
        started = 0
        start_counts: dict[str, int] = {}
        while True:
            while waiting and len(running) < slots:
                running.append(_Running(waiting.pop(0), started, task, max(deadline - time.monotonic(), 1), memory))
                started += 1
            for engine in list(running):
                if engine.process.poll() is not None:
                    result = engine.read_result()
                    if result is not None:
                        return result
                    running.remove(engine)
                    failures.append(engine.describe_failure())
                    start_counts[engine.entrant.name] = start_counts.get(engine.entrant.name, 1) + 1
                    if engine.process.returncode in KILLED and start_counts[engine.entrant.name] <= engine.entrant.starts:
                        waiting.insert(0, engine.entrant)
                elif waiting and time.monotonic() > engine.started_at + engine.entrant.share * seconds:
                    running.remove(engine)
                    engine.end()
            if not running and not waiting:
                raise RemoteError(f"no engine found a plan or a proof that there is none: {'; '.join(failures)}")
            if time.monotonic() > deadline:
                raise RemoteError(f"no plan was found in {seconds:g} s, and no proof that there is none")
            time.sleep(wait)
            wait = min(wait * 1.2, MOST_WAIT)


def run_all(entrants: Sequence[Entrant], task: Path, seconds: float, *, memory: int = MEMORY) -> list[EngineResult]:
    """The results that the engines, all in parallel, find within `seconds`."""
    deadline = time.monotonic() + seconds
    with _all_ended() as running:
        running += [_Running(entrant, number, task, seconds, memory) for number, entrant in enumerate(entrants)]
        while any(engine.process.poll() is None for engine in running) and time.monotonic() < deadline:
            time.sleep(MOST_WAIT / 2)
        return [result for engine in running if engine.plan_path.exists() and (result := engine.read_result()) is not None]

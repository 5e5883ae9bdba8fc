"""Engines side by side, each a process of its own: the first answer counts, and the others are ended.

Each has its share of the time, and of the memory. One that ends without an answer, however that came, makes room for the next.
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
"""Engines that run at a time, if there are so many processors."""
MEMORY = 4 * 1024**3
"""Bytes that an engine may use."""
MOST_WAIT = 0.05
"""Seconds between two looks at engines that take long."""
GRACE = 5
"""Seconds of computing on top of its time, after which the system ends an engine even if nobody is left to do so."""

KILLED = {-signal.SIGKILL, -signal.SIGTERM, -signal.SIGSEGV, -signal.SIGBUS}
"""How a process ends that something from outside ended, or a fault of its own that it may not have again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Entrant:
    """An engine that takes part: `command` for the files that hold the task and that it is to write the plan to."""

    name: str
    command: Callable[[Path, Path], Sequence[str]]
    share: float = 1.0
    """The part of the time that it may take, if others wait."""
    proves: frozenset[int] = frozenset()
    """The exit codes that say that there is no plan."""
    starts: int = 2
    """So often it is started when a signal that nobody here sent ends it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineResult:
    """What came out: the names of the plan's operators, or None if there is no plan; by whom."""

    engine_name: str
    operators: tuple[str, ...] | None


class _Running:
    """An engine under way: one process, of the group of whoever started it, and so ended with it."""

    def __init__(self, entrant: Entrant, number: int, task: Path, seconds: float, memory: int) -> None:
        self.entrant = entrant
        self.plan_path = task.with_name(f"plan-{number}")
        self.output_path = task.with_name(f"said-{number}")
        self.started_at = time.monotonic()
        with task.open("rb") as task_file, self.output_path.open("wb") as output_file:
            self.process = subprocess.Popen(entrant.command(task, self.plan_path), stdin=task_file, stdout=output_file, stderr=output_file)
        if sys.platform == "linux":
            with contextlib.suppress(ProcessLookupError):
                for kind, limit in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, round(seconds) + GRACE)):
                    resource.prlimit(self.process.pid, kind, (limit, limit))

    def end(self) -> None:
        self.process.kill()
        self.process.wait()

    def read_result(self) -> EngineResult | None:
        """What an engine that has ended found out."""
        if self.plan_path.exists():
            lines = self.plan_path.read_text(encoding="ascii").splitlines()
            return EngineResult(
                engine_name=self.entrant.name, operators=tuple(line.strip("()") for line in lines if not line.startswith(";"))
            )
        return EngineResult(engine_name=self.entrant.name, operators=None) if self.process.returncode in self.entrant.proves else None

    def describe_failure(self) -> str:
        last_lines = self.output_path.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-1:]
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
    """The first answer to the task in the file. Raises RemoteError when none comes in time. Whatever happens, no engine is left."""
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
                raise RemoteError(f"no engine found a plan, or that there is none: {'; '.join(failures)}")
            if time.monotonic() > deadline:
                raise RemoteError(f"no plan was found in {seconds:g} s, nor that there is none")
            time.sleep(wait)
            wait = min(wait * 1.2, MOST_WAIT)


def run_all(entrants: Sequence[Entrant], task: Path, seconds: float, *, memory: int = MEMORY) -> list[EngineResult]:
    """What each of them finds within the time, all at once."""
    deadline = time.monotonic() + seconds
    with _all_ended() as running:
        running += [_Running(entrant, number, task, seconds, memory) for number, entrant in enumerate(entrants)]
        while any(engine.process.poll() is None for engine in running) and time.monotonic() < deadline:
            time.sleep(MOST_WAIT / 2)
        return [result for engine in running if engine.plan_path.exists() and (result := engine.read_result()) is not None]

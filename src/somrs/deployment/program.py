"""One program of a system, as who started it sees it: its process, its log, and whether it hangs."""

from __future__ import annotations

import asyncio
import logging
import signal
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from somrs.deployment.launcher import Process
from somrs.deployment.programs import Ready
from somrs.deployment.watchdog import LoopWatch, read_activity, read_beat
from somrs.errors import UsageError
from somrs.runtime.wire import REMINDER

log = logging.getLogger(__name__)

PATIENCE = REMINDER + 5.0
"""Seconds after which a warning says that a program is not ready yet: by then, it has said in its log what it waits for."""

STOP_TIME = 5.0
"""Seconds that a program has to end after SIGTERM before it is killed."""


@dataclass(slots=True)
class Program:
    """One process of the system. `beat_file`: where it counts the turns of its event loop."""

    name: str
    arguments: list[str]
    process: Process
    log: Path
    beat_file: Path
    address: str = ""
    restarts: int = 0
    watch: LoopWatch = field(default_factory=LoopWatch)

    def replace_process(self, process: Process) -> None:
        """Go on with a new process after the end of the one before."""
        self.restarts += 1
        self.process, self.watch = process, LoopWatch()

    def hang_text(self) -> str | None:
        """Why the program hangs, for people; None if it does not. Called at regular times."""
        return self.watch.look(read_beat(self.beat_file), read_activity(self.process.pid))

    @property
    def exit_text(self) -> str:
        """How the process ended, for people."""
        code = self.process.returncode
        return f"signal {signal.Signals(-code).name}" if code is not None and code < 0 else f"exit code {code}"

    async def ready(self) -> None:
        """Wait until the program is ready. A slow start is not an error. Raises UsageError when the program ends first."""
        log_size = self.log.stat().st_size
        reading = asyncio.ensure_future(self.process.stdout.readline())
        try:
            while not (await asyncio.wait([reading], timeout=PATIENCE))[0]:
                log.warning("%s is not ready yet%s; its log is %s", self.name, self._last_words(log_size), self.log)
        finally:
            reading.cancel()
        if not (ready_line := reading.result()):
            await self.process.wait()
            raise UsageError(self._said_since(log_size) or f"{self.name} ended at once; see {self.log}")
        ready = msgspec.json.decode(ready_line, type=Ready)
        self.address = ready.address
        for problem in ready.problems:
            log.warning("%s; it is tried again", problem)

    def _said_since(self, log_size: int) -> str:
        """What it has written to its log since that had this size."""
        with self.log.open("rb") as output:
            output.seek(log_size)
            return output.read().decode(errors="replace").strip()

    def _last_words(self, log_size: int) -> str:
        """What it waits for, if it has said so: the last line since its log had this size, after a colon."""
        lines = self._said_since(log_size).splitlines()
        return f": {lines[-1]}" if lines else ""

    async def end(self) -> None:
        """Wait for the end of the program, and kill it when that takes long."""
        try:
            async with asyncio.timeout(STOP_TIME):
                await self.process.wait()
        except TimeoutError:
            self.process.kill()
            await self.process.wait()

"""The additional processes of a contestant."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import sys
from collections.abc import Mapping
from pathlib import Path

START_TIME = 30.0
"""Seconds for a process to report that it is ready."""

END_TIME = 5.0
"""Seconds for a process to end by itself."""


class Programs:
    """Processes that are started one after the other, and ended in the opposite order. Each ends when its standard input is closed."""

    def __init__(self, data: Path) -> None:
        self._data = data
        self._running: list[asyncio.subprocess.Process] = []

    async def start(self, module: str, *arguments: str, environment: Mapping[str, str] | None = None) -> str:
        """Run `contestants.MODULE` with the arguments, and return its report that it is ready."""
        line = [sys.executable, "-m", f"contestants.{module}", *arguments]
        process = await asyncio.create_subprocess_exec(
            *line,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            cwd=self._data,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[1]), "TMPDIR": str(self._data), **(environment or {})},
        )
        self._running.append(process)
        assert process.stdout is not None
        async with asyncio.timeout(START_TIME):
            first_line = await process.stdout.readline()
        if not first_line:
            raise RuntimeError(f"{module} {' '.join(arguments)} ended at once; see the log")
        return first_line.decode().strip()

    async def end(self) -> None:
        for process in reversed(self._running):
            assert process.stdin is not None
            process.stdin.close()
            try:
                async with asyncio.timeout(END_TIME):
                    await process.wait()
            except TimeoutError:
                with contextlib.suppress(ProcessLookupError):
                    process.kill()
                await process.wait()


async def wait_for_end() -> None:
    """Wait until standard input is closed: the process that started this one has ended, or wants it to end."""
    reader = asyncio.StreamReader()
    # This is not a thread, because a process that is forked meanwhile could never close its copy of standard input.
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    await reader.read()


def ready(word: str = "ready") -> None:
    print(word, flush=True)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port

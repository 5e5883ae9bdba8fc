"""Programs of other makes that speak VDA 5050, in processes of their own."""

from __future__ import annotations

import asyncio
import contextlib
import json
import shutil
import subprocess
from collections.abc import AsyncIterator, Mapping
from typing import Any

import pytest

from tests.support.paths import ROOT

NOT_INSTALLED = "NOT TESTED: VDA 5050 with npm's vda-5050-lib, because it is not in node_modules; `make javascript` installs it"


class ForeignProgram:
    """A program that writes lines of JSON, or of text."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process

    async def line(self) -> str:
        """The next line; waits for it."""
        assert self._process.stdout is not None
        line = await self._process.stdout.readline()
        assert line, "the program has ended"
        return line.decode().strip()

    async def event(self, name: str) -> dict[str, Any]:
        """The next event of this name; waits for it."""
        while True:
            event = json.loads(await self.line())
            if event["event"] == name:
                return dict(event)

    def kill(self) -> None:
        self._process.kill()


@contextlib.asynccontextmanager
async def foreign_program(name: str, configuration: Mapping[str, object]) -> AsyncIterator[ForeignProgram]:
    """Run a program of `tests/support/javascript`. Skips the test if its library is not installed."""
    node = shutil.which("node")
    if node is None or not (ROOT / "node_modules" / "vda-5050-lib").exists():
        pytest.skip(NOT_INSTALLED)
    program = str(ROOT / "tests" / "support" / "javascript" / name)
    process = await asyncio.create_subprocess_exec(node, program, json.dumps(configuration), stdout=subprocess.PIPE)
    try:
        yield ForeignProgram(process)
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()

"""The `somrs` command: within this process, which takes no time to start, and as a program of its own, as a user has it."""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from somrs.cli.main import command
from tests.support.hang import HANG_TIME


@dataclass(frozen=True)
class CommandResult:
    """How the command ended, and what it said."""

    returncode: int
    stdout: str
    stderr: str


def somrs(*arguments: str | Path, cwd: Path | None = None) -> CommandResult:
    """What a user reads who gives the command; errors that it does not expect are raised."""
    stdout, stderr = io.StringIO(), io.StringIO()
    folder_context = contextlib.chdir(cwd) if cwd is not None else contextlib.nullcontext()
    with folder_context, contextlib.redirect_stdout(stdout), contextlib.redirect_stderr(stderr), pytest.raises(SystemExit) as ended:
        command()([*map(str, arguments)], prog_name="somrs")
    code = ended.value.code or 0
    assert isinstance(code, int), f"a program that ends with {code!r} says it on standard error, and this one did not say it there"
    return CommandResult(code, stdout.getvalue(), stderr.getvalue())


def program(*arguments: str | Path, cwd: Path | None = None, **environment: str) -> CommandResult:
    """The same by a process of its own, in which these variables are set."""
    line = [sys.executable, "-m", "somrs.cli.main", *map(str, arguments)]
    env = {**os.environ, **environment}
    ended = subprocess.run(line, capture_output=True, text=True, cwd=cwd, env=env, timeout=HANG_TIME, check=False)
    return CommandResult(ended.returncode, ended.stdout, ended.stderr)

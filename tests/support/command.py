"""Runs the `somrs` command: within this process, which is fast, and as a separate program, as users do."""

from __future__ import annotations

import contextlib
import io
import tempfile
from dataclasses import dataclass
from pathlib import Path

import pytest

from somrs.cli.main import command
from tests.support.warm import Program


@dataclass(frozen=True)
class CommandResult:
    """The exit status and the output of a command."""

    returncode: int
    stdout: str
    stderr: str


def somrs(*arguments: str | Path, cwd: Path | None = None) -> CommandResult:
    """Run the command within this process, and return its result. Unexpected errors are raised."""
    stdout, stderr = io.StringIO(), io.StringIO()
    folder_context = contextlib.chdir(cwd) if cwd is not None else contextlib.nullcontext()
    with folder_context, contextlib.redirect_stdout(stdout), contextlib.redirect_stderr(stderr), pytest.raises(SystemExit) as ended:
        command()([*map(str, arguments)], prog_name="somrs")
    code = ended.value.code or 0
    assert isinstance(code, int), f"a program that exits with {code!r} prints it on standard error, and this process does not"
    return CommandResult(code, stdout.getvalue(), stderr.getvalue())


def program(*arguments: str | Path, cwd: Path | None = None, **environment: str) -> CommandResult:
    """Run the command as a separate process, with these environment variables."""
    with tempfile.TemporaryDirectory() as folder:
        output, errors = Path(folder, "output"), Path(folder, "errors")
        code = Program([*map(str, arguments)], output, errors, cwd, **environment).wait()
        return CommandResult(code, output.read_text(), errors.read_text())

"""A handle of the process that runs tests."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Self

from verification.mutants.runner import Event, RunRequest
from verification.mutants.tree import Tree


class Runner:
    """Runs requests in a tree, one after another."""

    def __init__(self, tree: Tree, modules: Path | None) -> None:
        command = [sys.executable, "-m", "verification.mutants.runner", *([str(modules)] if modules is not None else [])]
        self._process = subprocess.Popen(
            command, cwd=tree.root, env=tree.environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()

    def play(self, request: RunRequest) -> Iterator[Event]:
        """Run the request, and yield its events up to the end."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps(asdict(request)), file=self._process.stdin, flush=True)
        for line in self._process.stdout:
            event = Event(**json.loads(line))
            yield event
            if not event.test:
                return
        raise ChildProcessError(f"the process that runs the tests ended with {self._process.wait()}")

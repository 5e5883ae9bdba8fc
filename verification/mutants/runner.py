"""Runs tests, each time in a new process, forked from one that has loaded what tests need besides the project.

    python -m verification.mutants.runner

runs in the folder of a `tree`. It reads a `RunRequest` per line and writes an `Event` per line. It loads no module of the project before
the fork, so that each run gets the current version."""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import resource
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.support import leftovers

if TYPE_CHECKING:
    from coverage import Coverage

MEMORY = 4 << 30
"""The memory limit of a process, in bytes: a mutant that allocates without end has to fail before it affects the machine."""

OWN_PACKAGES = ("somrs", "tests", "verification", "conftest", "benchmarks", "scripts", "examples", "contestants")
"""Modules that are never loaded before the fork."""


@dataclass(frozen=True)
class RunRequest:
    """Tests to run in this order, up to the first failure. `limits` has the CPU seconds after which each test is stopped."""

    limits: dict[str, float] = field(default_factory=dict)
    log: str = os.devnull
    collect: float = 0.0
    """The limit for the time before the first test."""
    files: tuple[str, ...] = ()
    """If not empty: record all tests of these files instead."""
    record: str = ""
    """The file for the recording."""


@dataclass(frozen=True)
class Event:
    """The end of a test or, with an empty `test`, of the whole run."""

    test: str = ""
    outcome: str = ""
    seconds: float = 0.0
    status: int = 0
    """The exit status of pytest; a negative value is the signal that ended it."""
    modules: tuple[str, ...] = ()
    """After a recording: the modules that can be loaded before the fork."""


def write_event(event: Event, output: int) -> None:
    os.write(output, json.dumps(asdict(event)).encode() + b"\n")


class SelectedTests:
    """A pytest plugin that runs the requested tests in their order, each up to its limit, and reports the results."""

    def __init__(self, request: RunRequest, output: int) -> None:
        self._request = request
        self._output = output
        self._outcome = "passed"

    @pytest.hookimpl(wrapper=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> Iterator[None]:
        yield
        if self._request.limits:
            places = {test: place for place, test in enumerate(self._request.limits)}
            items[:] = sorted((item for item in items if item.nodeid in places), key=lambda item: places[item.nodeid])

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        if self._request.limits:
            _limit(self._request.limits[item.nodeid])
        self._outcome, started_at = "passed", time.perf_counter()
        result = yield
        write_event(Event(test=item.nodeid, outcome=self._outcome, seconds=time.perf_counter() - started_at), self._output)
        return result

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.outcome != "passed" and self._outcome != "failed":
            self._outcome = report.outcome


class Lines:
    """A pytest plugin that records the lines that each test reaches."""

    def __init__(self, coverage: Coverage) -> None:
        self._coverage = coverage

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self._coverage.switch_context(item.nodeid)
        os.environ["MUTANTS_TEST"] = item.nodeid
        result = yield
        self._coverage.switch_context("")
        return result


TIME_LIMIT_SIGNALS = (signal.SIGPROF, signal.SIGALRM)
"""The signals that end a process at a time limit, whatever it does."""

WAITING = 10.0
"""The ratio of the wall-clock limit to the CPU limit, which allows for other load and for waiting."""


def _limit(seconds: float) -> None:
    """Stop the process after so many CPU seconds from now, or a multiple of them by the wall clock.

    Many mutants are endless loops, or wait for ever. The main limit is CPU time, so that other load on the machine does not stop a test
    that would pass.
    """
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_REAL, WAITING * seconds)


PYTEST = ["-q", "-p", "no:cacheprovider", "--tb=short"]


def _run(request: RunRequest, output: int) -> int:
    """Run the request in the forked process, and return the exit status."""
    if request.record:
        return _record(request, output)
    for ends in TIME_LIMIT_SIGNALS:
        signal.signal(ends, signal.SIG_DFL)
    _limit(request.collect)
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    paths = list(dict.fromkeys(test.partition("::")[0] for test in request.limits))
    return pytest.main([*PYTEST, "-x", *paths], plugins=[SelectedTests(request, output)])


def _record(request: RunRequest, output: int) -> int:
    from coverage import Coverage

    # Programs that a test starts record their calls themselves.
    os.environ["MUTANTS_CALLS"] = str(Path(request.record).with_suffix(".calls"))
    os.environ["PYTHONPATH"] += os.pathsep + str(Path(__file__).parent / "inside")
    coverage = Coverage(data_file=request.record, source_pkgs=["somrs"], config_file=False)
    coverage.load()
    coverage.start()
    status = pytest.main([*PYTEST, *request.files], plugins=[Lines(coverage), SelectedTests(request, output)])
    coverage.stop()
    coverage.save()
    loaded = sorted(name for name in sys.modules if name.partition(".")[0] not in OWN_PACKAGES and not name.startswith("_"))
    write_event(Event(test="modules", outcome="modules", modules=tuple(loaded)), output)
    return status


def play(request: RunRequest, output: int) -> None:
    """Run the tests in a new process, and end all processes that they started."""
    process = os.fork()
    if not process:
        status = 3
        try:
            log = os.open(request.log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            os.dup2(log, 1)
            os.dup2(log, 2)
            status = _run(request, output)
            sys.stdout.flush()
        finally:
            os._exit(status)
    _, ended = os.waitpid(process, 0)
    leftovers.end({})
    write_event(Event(status=os.waitstatus_to_exitcode(ended)), output)


def main() -> None:
    leftovers.adopt_orphans()
    output = os.dup(1)
    os.set_inheritable(output, False)
    os.dup2(2, 1)
    for name in Path(sys.argv[1]).read_text().split() if len(sys.argv) > 1 else ():
        with contextlib.suppress(Exception):
            importlib.import_module(name)
    for line in sys.stdin:
        read = json.loads(line)
        play(RunRequest(**{**read, "files": tuple(read["files"])}), output)


if __name__ == "__main__":
    main()

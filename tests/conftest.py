"""For all tests: how property tests run, which tests begin first, that nobody leaves a process behind, and what is not tested because
something is missing, which is said loudly."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from xdist.scheduler import LoadScopeScheduling  # type: ignore[import-untyped]

from tests.support import leftovers
from tests.support.examples import PROFILE

settings.register_profile("somrs", PROFILE)
settings.load_profile("somrs")

FOLDERS = ("browser", "system", "integration", "unit")
"""Tests of whole systems wait most: they begin first, and others fill the gaps."""

WORKER_GROUPS = {
    "browser/test_api": "quiet pages",
    "browser/test_history": "quiet pages",
    "browser/test_owl": "quiet pages",
    "browser/test_start": "quiet pages",
    "browser": "",
    "system/test_cli_editing": "",
    "system/test_fault_runs": "",
}
"""Files, and folders of files, whose tests are all run by one worker, as they share what takes long to make; files of one name, too."""


class GroupScheduling(LoadScopeScheduling):  # type: ignore[misc]
    """Gives single tests to whoever is free, and those that belong `WORKER_GROUPS` to one worker."""

    def _split_scope(self, nodeid: str) -> str:
        file = nodeid.partition("::")[0].removesuffix(".py")
        for place, name in WORKER_GROUPS.items():
            if f"{file}/".startswith(f"tests/{place}/"):
                return name or file
        return nodeid


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> GroupScheduling | None:
    return GroupScheduling(config, log) if config.getvalue("dist") == "loadscope" else None


def pytest_configure(config: pytest.Config) -> None:
    leftovers.adopt_orphans()
    if (worker := getattr(config, "workerinput", None)) is not None:
        config.args = _begun_elsewhere(config.args, int(worker["workerid"].removeprefix("gw")), worker["workercount"])


def _begun_elsewhere(args: list[str], number: int, count: int) -> list[str]:
    """All files to collect, from another place on for each worker: in a fresh clone pytest compiles each file, and so not each worker
    compiles all of them. `pytest_collection_modifyitems` puts their tests in one order again."""
    if not all(Path(arg).is_dir() for arg in args):
    if not all(Path(arg).is_dir() for arg in args):
        return args
    files = [str(file) for arg in args for file in sorted(Path(arg).rglob("test_*.py"))]
    begin = len(files) * number // count
    return [*files[begin:], *files[:begin]]


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long tests first, so that at the end nobody waits for one that began last; files in one order for all workers."""

    def rank(item: pytest.Item) -> tuple[bool, int, Path]:
        folder = next((place for place, name in enumerate(FOLDERS) if f"tests/{name}/" in item.nodeid), len(FOLDERS))
        return item.get_closest_marker("long") is None, folder, item.path

    items.sort(key=rank)


def pytest_collection_finish() -> None:
    """What was collected stays until the end: nobody need look again and again whether it is garbage."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def _no_leftover_processes() -> Iterator[None]:
    """What a test started it ends, also when it fails; else it is ended here and the test is an error."""
    processes_before = leftovers.processes()
    yield
    remaining = leftovers.end(processes_before)
    assert not remaining, "left running: " + "; ".join(remaining)


def pytest_sessionfinish(session: pytest.Session) -> None:
    remaining = leftovers.end({}) if hasattr(session.config, "workerinput") or not session.config.getoption("numprocesses", None) else []
    for line in remaining:
        print(f"left running by a fixture, and killed: {line}")
    if remaining:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    reasons: dict[str, int] = {}
    for report in terminalreporter.getreports("skipped"):
        reason = str(report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr).removeprefix("Skipped: ")
        reasons[reason] = reasons.get(reason, 0) + 1
    for reason, count in sorted(reasons.items()):
        terminalreporter.write_line(f"NOT TESTED ({count} test{'s' if count > 1 else ''} skipped): {reason}", yellow=True, bold=True)
    failed = sum(len(terminalreporter.stats.get(kind, ())) for kind in ("failed", "error"))
    terminalreporter.write_line(f"{len(terminalreporter.stats.get('passed', ()))} passed, {failed} failed")

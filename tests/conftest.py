"""Settings for all tests: property tests, the order of tests, a check for processes that a test leaves, and a notice of tests that are
skipped because something is missing."""

from __future__ import annotations

import fcntl
import gc
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from xdist.scheduler import LoadScopeScheduling  # type: ignore[import-untyped]

from somrs.devices.simulator.world.kinds import WorldKind
from tests.support import leftovers
from tests.support.examples import PROFILE
from tests.support.paths import ROOT

settings.register_profile("somrs", PROFILE)
settings.load_profile("somrs")


@pytest.fixture(params=WorldKind)
def world(request: pytest.FixtureRequest) -> WorldKind:
    """Both kinds of simulated worlds, one after the other."""
    return WorldKind(request.param)


@pytest.fixture(scope="session")
def ros2() -> None:
    """ROS 2, which may still be set up when tests begin: `scripts/ros2` holds a lock meanwhile."""
    (lock := ROOT / "out" / "ros2.lock").parent.mkdir(exist_ok=True)
    with lock.open("a") as file:
        fcntl.flock(file, fcntl.LOCK_SH)
    if not (ROOT / ".venv-ros2" / ".ready").exists():
        pytest.skip("ROS 2 is not set up in .venv-ros2; scripts/ros2 does it, or says why it cannot")


FOLDERS = ("browser", "system", "integration", "unit")
"""The order of the folders. Tests of whole systems mostly wait, so they begin first, and other tests fill the gaps."""

WORKER_GROUPS = {
    "browser/test_accessibility": "quiet pages",
    "browser/test_api": "quiet pages",
    "browser/test_history": "quiet pages",
    "browser/test_owl": "quiet pages",
    "browser/test_start": "quiet pages",
    "browser": "",
    "system/test_cli_editing": "",
    "system/test_distribution": "",
    "system/test_fault_runs": "",
}
"""Files and folders whose tests run in one worker, as they share fixtures that take long to make. Equal names share a worker, too."""


class GroupScheduling(LoadScopeScheduling):  # type: ignore[misc]
    """Gives single tests to any free worker, and the tests of each of the `WORKER_GROUPS` to one worker."""

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
    """Return all files to collect, in an order that begins at another file for each worker: in a fresh clone pytest compiles each file, and
    so the workers share this work. `pytest_collection_modifyitems` puts the tests in one order again."""
    if not all(Path(arg).is_dir() for arg in args):
        return args
    files = [str(file) for arg in args for file in sorted(Path(arg).rglob("test_*.py"))]
    begin = len(files) * number // count
    return [*files[begin:], *files[:begin]]


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sort the tests: long ones first, so that none of them begins last, of these those with ROS 2 last, and files in the same
    order for all workers."""

    def rank(item: pytest.Item) -> tuple[bool, bool, int, Path]:
        is_long = item.get_closest_marker("long") is not None
        folder = next((place for place, name in enumerate(FOLDERS) if f"tests/{name}/" in item.nodeid), len(FOLDERS))
        return not is_long, is_long and "ros2" in getattr(item, "fixturenames", ()), folder, item.path

    items.sort(key=rank)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Exclude all collected objects from garbage collection, as they stay until the end, and do not look for garbage meanwhile."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.fixture(autouse=True)
def _no_leftover_processes() -> Iterator[None]:
    """Fail a test that leaves a process, also after another failure, and end the process."""
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
    gc.collect()
    gc.freeze()  # pytest looks five times for garbage that complains when it is collected: what stays need not be looked at as often


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    reasons: dict[str, int] = {}
    for report in terminalreporter.getreports("skipped"):
        reason = str(report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr).removeprefix("Skipped: ")
        reasons[reason] = reasons.get(reason, 0) + 1
    for reason, count in sorted(reasons.items()):
        terminalreporter.write_line(f"NOT TESTED ({count} test{'s' if count > 1 else ''} skipped): {reason}", yellow=True, bold=True)
    failed = sum(len(terminalreporter.stats.get(kind, ())) for kind in ("failed", "error"))
    terminalreporter.write_line(f"{len(terminalreporter.stats.get('passed', ()))} passed, {failed} failed")

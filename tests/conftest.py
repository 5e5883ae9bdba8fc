"""For all tests: how property tests run, and what is not tested because something is missing, which is said loudly."""

from __future__ import annotations

import pytest
from hypothesis import settings

from tests.support.examples import PROFILE

settings.register_profile("somrs", PROFILE)
settings.load_profile("somrs")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    reasons: dict[str, int] = {}
    for report in terminalreporter.getreports("skipped"):
        reason = str(report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr).removeprefix("Skipped: ")
        reasons[reason] = reasons.get(reason, 0) + 1
    for reason, count in sorted(reasons.items()):
        terminalreporter.write_line(f"NOT TESTED ({count} test{'s' if count > 1 else ''} skipped): {reason}", yellow=True, bold=True)

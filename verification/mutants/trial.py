"""Runs the tests that reach a mutant."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import accumulate, islice
from pathlib import Path

from somrs.errors import SomrsError
from verification.mutants.mutations import Mutant
from verification.mutants.record import Record
from verification.mutants.runner import TIME_LIMIT_SIGNALS, RunRequest
from verification.mutants.runner_process import Runner
from verification.mutants.tree import Tree

FIRST = (10, 50)
"""The sizes of the first two batches of tests. Most mutants are caught in these, which import few test files."""

TIMES, FLOOR = 10.0, 20.0
"""A test's limit of CPU time: so many times its duration without a mutant, plus so many seconds."""

COULD_NOT_RUN = (4, 5)
"""The exit statuses of pytest for wrong usage and for no tests."""


@dataclass(frozen=True)
class Result:
    """The result of a mutant."""

    mutant: Mutant
    diff: str
    tests: int
    """The number of tests that reach the mutant."""
    caught_by: str = ""

    @property
    def caught(self) -> bool:
        return bool(self.caught_by)


def try_mutant(
    mutant: Mutant, record: Record, tree: Tree, runner: Runner, log: Path, floor: float = FLOOR, time_budget: float = math.inf
) -> Result:
    """Run the mutant's tests up to the first failure, but only the fastest ones that take `time_budget` seconds together."""
    source = (tree.root / mutant.file).read_bytes()
    reached = record.tests_reaching(mutant)
    chosen = {test: reached[test] for test, total in zip(reached, accumulate(reached.values()), strict=True) if total <= time_budget}
    caught_by = ""
    remaining = iter(chosen.items())
    with tree.changed(mutant.file, mutant.applied(source)):
        for size in (*FIRST, len(chosen)):
            tests = dict(islice(remaining, size))
            if tests and not caught_by:
                caught_by = _catching_test(tests, runner, log, floor)
    return Result(mutant, mutant.diff(source), len(chosen), caught_by)


def _catching_test(tests: dict[str, float], runner: Runner, log: Path, floor: float) -> str:
    """Return the test that fails, or another end of the run that catches the mutant; otherwise an empty string."""
    limits = {test: floor + TIMES * seconds for test, seconds in tests.items()}
    remaining = iter(tests)
    failed = ""
    for event in runner.play(RunRequest(limits=limits, log=str(log), collect=TIMES * FLOOR)):
        if event.test:
            next(remaining, None)
            if event.outcome == "failed":
                failed = event.test
        elif event.status in COULD_NOT_RUN:
            raise SomrsError(f"the tests could not be run, see {log}")
        elif -event.status in TIME_LIMIT_SIGNALS:
            return f"{next(remaining, 'every test')}, which never ends"
        elif event.status:
            return failed or "the import of the tests"
    return ""

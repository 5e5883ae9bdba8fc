"""A mutant is put through the tests that reach it."""

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
"""So many tests are tried before all others, and then so many: most mutants go no further, and few files have to be read for them."""

TIMES, FLOOR = 10.0, 20.0
"""A test is given up after so many times the seconds that it took without a mutant, and so many more, of work."""

COULD_NOT_RUN = (4, 5)
"""Of pytest: it was called wrongly, and there were no tests."""


@dataclass(frozen=True)
class Result:
    """What became of a mutant."""

    mutant: Mutant
    diff: str
    tests: int
    """That reach it."""
    caught_by: str = ""

    @property
    def caught(self) -> bool:
        return bool(self.caught_by)


def try_mutant(
    mutant: Mutant, record: Record, tree: Tree, runner: Runner, log: Path, floor: float = FLOOR, time_budget: float = math.inf
) -> Result:
    """Run its tests up to the first that fails; not those after as many as take `time_budget` seconds."""
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
    """Which of the tests fails, or how they end otherwise."""
    limits = {test: floor + TIMES * seconds for test, seconds in tests.items()}
    remaining = iter(tests)
    failed = ""
    for event in runner.play(RunRequest(limits=limits, log=str(log), collect=TIMES * FLOOR)):
        if event.test:
            next(remaining, None)
            if event.outcome == "failed":
                failed = event.test
        elif event.status in COULD_NOT_RUN:
            raise SomrsError(f"the tests could not be run, as {log} tells")
        elif -event.status in TIME_LIMIT_SIGNALS:
            return f"{next(remaining, 'every test')}, whose end is never reached"
        elif event.status:
            return failed or "the import of the tests"
    return ""

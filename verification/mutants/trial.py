"""A mutant is put through the tests that reach it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import accumulate, islice
from pathlib import Path

from somrs.errors import SomrsError
from verification.mutants.mutations import Mutant
from verification.mutants.record import Record
from verification.mutants.runner import GIVEN_UP, Wanted
from verification.mutants.running import Runner
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


def tried(mutant: Mutant, record: Record, tree: Tree, runner: Runner, log: Path, floor: float = FLOOR, within: float = math.inf) -> Result:
    """Run its tests up to the first that fails; not those after as many as take `within` seconds."""
    source = (tree.root / mutant.file).read_bytes()
    reached = record.chosen(mutant)
    chosen = {test: reached[test] for test, all in zip(reached, accumulate(reached.values()), strict=True) if all <= within}
    caught_by = ""
    left = iter(chosen.items())
    with tree.changed(mutant.file, mutant.applied(source)):
        for size in (*FIRST, len(chosen)):
            tests = dict(islice(left, size))
            if tests and not caught_by:
                caught_by = _caught(tests, runner, log, floor)
    return Result(mutant, mutant.diff(source), len(chosen), caught_by)


def _caught(tests: dict[str, float], runner: Runner, log: Path, floor: float) -> str:
    """Which of the tests fails, or how they end otherwise."""
    limits = {test: floor + TIMES * seconds for test, seconds in tests.items()}
    left = iter(tests)
    failed = ""
    for event in runner.play(Wanted(limits=limits, log=str(log), collect=TIMES * FLOOR)):
        if event.test:
            next(left, None)
            if event.outcome == "failed":
                failed = event.test
        elif event.status in COULD_NOT_RUN:
            raise SomrsError(f"the tests could not be run, as {log} tells")
        elif -event.status in GIVEN_UP:
            return f"{next(left, 'every test')}, whose end is never reached"
        elif event.status:
            return failed or "the import of the tests"
    return ""

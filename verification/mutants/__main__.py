"""Changes the core in small ways, one at a time, and sees whether a test notices.

    python -m verification.mutants [--sample 300] [--seed 0] [--only planner/relevance.py:57:2] [--within 5] [--out out/mutants]

Closes with `N caught, N survived`; the exit status is 1 when fewer than 90 % are caught. All results are in out/mutants/results.jsonl.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import random
import sys
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from somrs.errors import SomrsError
from verification.mutants.mutations import Mutant, all_mutants
from verification.mutants.record import Record
from verification.mutants.running import Runner
from verification.mutants.tree import Tree
from verification.mutants.trial import FLOOR, Result, tried

CORE = ("entish", "ontology", "protocol", "planner", "kernel", "repository", "registry", "service_manager", "task_manager")
ENOUGH = 0.9
SAMPLE = 300
NEEDS = {"src/somrs/planner/search/numeric.py": "pytyr"}
"""What is tested only where a package is installed that need not be."""
COLUMNS = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())


def testable(every: list[Mutant]) -> list[Mutant]:
    """Without those of modules that cannot be tested here, which is said."""
    missing = {file: package for file, package in NEEDS.items() if importlib.util.find_spec(package) is None}
    for file, package in missing.items():
        print(f"NOT TESTED: the mutants of {file}, because {package} is not installed")
    return [mutant for mutant in every if mutant.file not in missing]


def drawn(every: list[Mutant], size: int, seed: int) -> list[Mutant]:
    """A sample, in any order, so that what is seen of it on the way is one, too."""
    return random.Random(seed).sample(every, min(size, len(every)))


def asked_for(every: list[Mutant], names: str) -> list[Mutant]:
    """Those of a folder, of a file, of a line of it, or a single one; several are parted by commas."""
    found: list[Mutant] = []
    for name in names.split(","):
        these = [mutant for mutant in every if f"{mutant.name}:".startswith((f"{name}:", f"{name.rstrip('/')}/"))]
        if not these:
            raise SomrsError(f"there is no mutant {name}")
        found += these
    return found


def play(mutants: list[Mutant], trees: list[Tree], out: Path, console: Console, floor: float, within: float) -> list[Result]:
    """What became of each, also line by line in a file."""
    record = Record(trees[0].root, out)
    if stale := record.stale:
        with Progress(TextColumn("{task.description}"), MofNCompleteColumn(), TimeElapsedColumn(), console=console) as bar:
            shown = bar.add_task(f"seeing which lines the tests of {len(stale)} files reach", total=None)
            record.renew(trees[0], lambda: bar.advance(shown))
    left, results = deque(mutants), list[Result]()
    with (
        (out / "results.jsonl").open("w", encoding="utf-8") as kept,
        Progress(*COLUMNS, console=console) as bar,
        ThreadPoolExecutor(len(trees)) as workers,
    ):
        shown = bar.add_task("mutants", total=len(mutants))

        def work(tree: Tree) -> None:
            with Runner(tree, record.modules) as runner:
                while left:
                    result = tried(left.popleft(), record, tree, runner, tree.root.with_suffix(".log"), floor, within)
                    results.append(result)
                    row = {"name": result.mutant.name, "diff": result.diff, "tests": result.tests, "caught by": result.caught_by}
                    print(json.dumps(row, ensure_ascii=False), file=kept, flush=True)
                    bar.update(shown, advance=1, description=f"{sum(one.caught for one in results)} of {len(results)} caught")

        for done in [workers.submit(work, tree) for tree in trees]:
            done.result()
    return sorted(results, key=lambda result: (result.mutant.file, result.mutant.start))


def summary(survivors: list[Result]) -> Table:
    table = Table(title="Survivors", title_justify="left", show_lines=True)
    table.add_column("mutant", overflow="fold")
    table.add_column("change", overflow="fold")
    table.add_column("tests that reach it", justify="right")
    for result in survivors:
        table.add_row(result.mutant.name, Text(result.diff), f"{result.tests}" if result.tests else "none")
    return table


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sample", type=int, help=f"so many of them; {SAMPLE}, if none are named")
    parser.add_argument("--seed", type=int, help="which sample")
    parser.add_argument(
        "--only", help="a folder, a file, a line of it or a mutant of the line, as the table names them; several are parted by commas"
    )
    parser.add_argument("--jobs", type=int, default=2, help="so many at the same time")
    parser.add_argument("--floor", type=float, default=FLOOR, help="seconds of work that every test has")
    parser.add_argument(
        "--within", type=float, default=math.inf, help="try each with its fastest tests only, which take so many seconds together"
    )
    parser.add_argument("--out", type=Path, default=Path("out/mutants"))
    arguments = parser.parse_args()
    console = Console()
    out = arguments.out.resolve()
    seed = random.randrange(10_000) if arguments.seed is None else arguments.seed
    try:
        trees = [Tree(out / "trees" / f"{number}") for number in range(arguments.jobs)]
        every = testable(all_mutants(trees[0].root, CORE))
        named = asked_for(every, arguments.only) if arguments.only else every
        all_of_them = arguments.only and not arguments.sample
        mutants = named if all_of_them else drawn(named, arguments.sample or SAMPLE, seed)
        print(f"{len(mutants)} of {len(every)} mutants" + ("" if all_of_them else f", SEED={seed}"))
        results = play(mutants, trees[: len(mutants)], out, console, arguments.floor, arguments.within)
    except SomrsError as error:
        print(error, file=sys.stderr)
        return 2
    survivors = [result for result in results if not result.caught]
    if survivors:
        console.print(summary(survivors))
    if arguments.only:
        for result in results:
            if result.caught:
                print(f"{result.mutant.name} is caught by {result.caught_by}")
    caught = len(results) - len(survivors)
    print(f"{caught} caught, {len(survivors)} survived")
    return 0 if caught >= ENOUGH * len(results) else 1


if __name__ == "__main__":
    sys.exit(main())

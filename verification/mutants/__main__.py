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


class Tried:
    """What became of mutants, kept line by line: a sample that was stopped is gone on with, as long as code and tests stay as they are."""

    def __init__(self, place: Path, of: str) -> None:
        self._place, self._of = place, of
        lines = place.read_text(encoding="utf-8").splitlines(keepends=True) if place.exists() else []
        whole = [line for line in lines if line.endswith("\n")]  # who is killed may leave a part of one
        if whole != lines:
            place.write_text("".join(whole), encoding="utf-8")
        rows = [json.loads(line) for line in whole]
        self._rows = {row["name"]: row for row in rows if row["of"] == of}

    def before(self, mutant: Mutant) -> Result | None:
        row = self._rows.get(mutant.name)
        return Result(mutant, row["diff"], row["tests"], row["caught by"]) if row is not None else None

    def keep(self, result: Result) -> None:
        with self._place.open("a", encoding="utf-8") as kept:
            print(json.dumps({**_row(result), "of": self._of}, ensure_ascii=False), file=kept, flush=True)


def _row(result: Result) -> dict[str, object]:
    return {"name": result.mutant.name, "diff": result.diff, "tests": result.tests, "caught by": result.caught_by}


def play(
    mutants: list[Mutant], trees: list[Tree], out: Path, console: Console, floor: float, within: float, *, anew: bool = False
) -> list[Result]:
    """What became of each, also line by line in a file. `anew`: also of those that were tried before."""
    record = Record(trees[0].root, out)
    if stale := record.stale:
        with Progress(TextColumn("{task.description}"), MofNCompleteColumn(), TimeElapsedColumn(), console=console) as bar:
            shown = bar.add_task(f"seeing which lines the tests of {len(stale)} files reach", total=None)
            record.renew(trees[0], lambda: bar.advance(shown))
    kept = Tried(out / "tried.jsonl", f"{record.version} {floor} {within}")
    results = [result for mutant in mutants if not anew and (result := kept.before(mutant)) is not None]
    if results:
        console.print(f"{len(results)} of them were tried before, with code and tests as they are")
    known = {result.mutant.name for result in results}
    left = deque(mutant for mutant in mutants if mutant.name not in known)
    with Progress(*COLUMNS, console=console) as bar, ThreadPoolExecutor(len(trees)) as workers:
        shown = bar.add_task("mutants", total=len(mutants), completed=len(results))

        def work(tree: Tree) -> None:
            with Runner(tree, record.modules) as runner:
                while left:
                    result = tried(left.popleft(), record, tree, runner, tree.root.with_suffix(".log"), floor, within)
                    results.append(result)
                    kept.keep(result)
                    bar.update(shown, advance=1, description=f"{sum(one.caught for one in results)} of {len(results)} caught")

        for done in [workers.submit(work, tree) for tree in trees]:
            done.result()
    results.sort(key=lambda result: (result.mutant.file, result.mutant.start))
    (out / "results.jsonl").write_text("".join(json.dumps(_row(one), ensure_ascii=False) + "\n" for one in results), encoding="utf-8")
    return results


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
        results = play(mutants, trees[: len(mutants)], out, console, arguments.floor, arguments.within, anew=bool(arguments.only))
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

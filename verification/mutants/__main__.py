"""Makes small changes to the core, one at a time, and checks whether a test fails.

    python -m verification.mutants [--sample 300] [--seed 0] [--only planner/relevance.py:57:2] [--within 5] [--out out/mutants]

The last line is `N caught, N survived`; the exit status is 1 if fewer than 90 % are caught. out/mutants/results.jsonl has all results.
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
from verification.mutants.runner_process import Runner
from verification.mutants.tree import Tree
from verification.mutants.trial import FLOOR, Result, try_mutant

CORE = ("entish", "ontology", "protocol", "planner", "kernel", "repository", "registry", "service_manager", "task_manager")
MIN_CAUGHT_SHARE = 0.9
SAMPLE = 300
OPTIONAL_PACKAGES = {"src/somrs/planner/search/numeric.py": "pytyr"}
"""Files that are tested only if an optional package is installed."""
COLUMNS = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())


def testable(mutants: list[Mutant]) -> list[Mutant]:
    """Return the mutants without those of modules that cannot be tested here, and print a notice of these."""
    missing = {file: package for file, package in OPTIONAL_PACKAGES.items() if importlib.util.find_spec(package) is None}
    for file, package in missing.items():
        print(f"NOT TESTED: the mutants of {file}, because {package} is not installed")
    return [mutant for mutant in mutants if mutant.file not in missing]


def draw_sample(mutants: list[Mutant], size: int, seed: int) -> list[Mutant]:
    """Return a sample in random order, so that intermediate results are representative, too."""
    return random.Random(seed).sample(mutants, min(size, len(mutants)))


def select_mutants(mutants: list[Mutant], names: str) -> list[Mutant]:
    """Return the mutants of the named folders, files, lines or single mutants; `names` are separated by commas."""
    selected: list[Mutant] = []
    for name in names.split(","):
        matching = [mutant for mutant in mutants if f"{mutant.name}:".startswith((f"{name}:", f"{name.rstrip('/')}/"))]
        if not matching:
            raise SomrsError(f"there is no mutant {name}")
        selected += matching
    return selected


class ResultStore:
    """The results so far, stored line by line. An interrupted sample continues if code and tests are unchanged."""

    def __init__(self, place: Path, version: str) -> None:
        self._place, self._version = place, version
        lines = place.read_text(encoding="utf-8").splitlines(keepends=True) if place.exists() else []
        whole = [line for line in lines if line.endswith("\n")]  # a killed run may leave an incomplete line
        if whole != lines:
            place.write_text("".join(whole), encoding="utf-8")
        rows = [json.loads(line) for line in whole]
        self._rows = {row["name"]: row for row in rows if row["of"] == version}

    def earlier_result(self, mutant: Mutant) -> Result | None:
        row = self._rows.get(mutant.name)
        return Result(mutant, row["diff"], row["tests"], row["caught by"]) if row is not None else None

    def save(self, result: Result) -> None:
        with self._place.open("a", encoding="utf-8") as file:
            print(json.dumps({**_row(result), "of": self._version}, ensure_ascii=False), file=file, flush=True)


def _row(result: Result) -> dict[str, object]:
    return {"name": result.mutant.name, "diff": result.diff, "tests": result.tests, "caught by": result.caught_by}


def play(
    mutants: list[Mutant], trees: list[Tree], out_folder: Path, console: Console, floor: float, time_budget: float, *, anew: bool = False
) -> list[Result]:
    """Test the mutants, store each result, and return all results. With `anew`, repeat those with a stored result."""
    record = Record(trees[0].root, out_folder)
    if stale := record.stale:
        with Progress(TextColumn("{task.description}"), MofNCompleteColumn(), TimeElapsedColumn(), console=console) as bar:
            progress_task = bar.add_task(f"recording the lines that the tests of {len(stale)} files reach", total=None)
            record.renew(trees[0], lambda: bar.advance(progress_task))
    result_store = ResultStore(out_folder / "tried.jsonl", f"{record.version} {floor} {time_budget}")
    results = [result for mutant in mutants if not anew and (result := result_store.earlier_result(mutant)) is not None]
    if results:
        console.print(f"{len(results)} of them have results for the same code and tests")
    known_names = {result.mutant.name for result in results}
    remaining = deque(mutant for mutant in mutants if mutant.name not in known_names)
    with Progress(*COLUMNS, console=console) as bar, ThreadPoolExecutor(len(trees)) as workers:
        progress_task = bar.add_task("mutants", total=len(mutants), completed=len(results))

        def work(tree: Tree) -> None:
            with Runner(tree, record.modules) as runner:
                while remaining:
                    result = try_mutant(remaining.popleft(), record, tree, runner, tree.root.with_suffix(".log"), floor, time_budget)
                    results.append(result)
                    result_store.save(result)
                    bar.update(progress_task, advance=1, description=f"{sum(item.caught for item in results)} of {len(results)} caught")

        for future in [workers.submit(work, tree) for tree in trees]:
            future.result()
    results.sort(key=lambda result: (result.mutant.file, result.mutant.start))
    (out_folder / "results.jsonl").write_text(
        "".join(json.dumps(_row(item), ensure_ascii=False) + "\n" for item in results), encoding="utf-8"
    )
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
    parser.add_argument("--sample", type=int, help=f"size of the sample; {SAMPLE}, unless mutants are named")
    parser.add_argument("--seed", type=int, help="selects the sample")
    parser.add_argument(
        "--only", help="a folder, a file, a line of it or a mutant of the line, as the table names them; separated by commas"
    )
    parser.add_argument("--jobs", type=int, default=2, help="number of mutants at the same time")
    parser.add_argument("--floor", type=float, default=FLOOR, help="seconds of CPU time that every test has at least")
    parser.add_argument(
        "--within", type=float, default=math.inf, help="run only the fastest tests of each mutant, which take so many seconds together"
    )
    parser.add_argument("--out", type=Path, default=Path("out/mutants"))
    arguments = parser.parse_args()
    console = Console()
    out_folder = arguments.out.resolve()
    seed = random.randrange(10_000) if arguments.seed is None else arguments.seed
    try:
        trees = [Tree(out_folder / "trees" / f"{number}") for number in range(arguments.jobs)]
        candidates = testable(all_mutants(trees[0].root, CORE))
        named = select_mutants(candidates, arguments.only) if arguments.only else candidates
        is_complete = arguments.only and not arguments.sample
        mutants = named if is_complete else draw_sample(named, arguments.sample or SAMPLE, seed)
        print(f"{len(mutants)} of {len(candidates)} mutants" + ("" if is_complete else f", SEED={seed}"))
        results = play(mutants, trees[: len(mutants)], out_folder, console, arguments.floor, arguments.within, anew=bool(arguments.only))
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
    return 0 if caught >= MIN_CAUGHT_SHARE * len(results) else 1


if __name__ == "__main__":
    sys.exit(main())

"""`make bench-codmap`: solves every problem of every domain in a folder, from the files to the goal in the world.

Each problem is imported, planned, arranged with one Service Manager for each agent over the real protocol, and executed on a symbolic
world that rejects any step whose precondition does not hold there. This happens in one process on virtual time; only planning takes real
time, and uses all cores. External validators check the plan.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from verification.codmap.problem_run import run_problem
from verification.codmap.referee import judges
from verification.codmap.result import Result
from verification.codmap.table import table

WIDTH = 140
"""The width of the table in a file, in characters."""


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m verification.codmap", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="contains a folder for each domain, with a folder for each problem in it")
    parser.add_argument("--limit", type=float, default=60.0, help="seconds for planning a problem")
    parser.add_argument("--faults", type=float, default=0.0, help="share of steps that fail; in a fifth of the problems, one agent leaves")
    parser.add_argument("--seed", type=int, default=0, help="selects the faults")
    parser.add_argument("--only", default="", help="only problems whose name (domain/problem) contains this")
    parser.add_argument("--tell", action="store_true", help="print the course of each task")
    chosen = parser.parse_args()
    console = Console(soft_wrap=True, highlight=False, width=None if sys.stdout.isatty() else WIDTH)
    folders = [place for place in problems(chosen.folder) if chosen.only in f"{place.parent.name}/{place.name}"]
    if not folders:
        named = f" with {chosen.only} in its name" if chosen.only else ""
        parser.error(f"{chosen.folder}: no folder of a folder in it contains a problem.pddl{named}")
    results: list[Result] = []
    started_at = time.perf_counter()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        bar = progress.add_task("problems", total=len(folders))
        for place in folders:
            progress.update(bar, description=f"{place.parent.name}/{place.name}")
            result = run_problem(place, chosen.limit, chosen.faults, chosen.seed)
            results.append(result)
            progress.update(bar, advance=1)
            console.print(line(result))
            if chosen.tell:
                console.print(escape("\n".join(f"    {note}" for note in result.notes)))
    console.print(f"Plans were validated by {' and '.join(judges())}.")
    console.print(table(results, time.perf_counter() - started_at))
    failed = sum(bool(result.trouble) for result in results)
    console.print(f"{len(results) - failed} passed, {failed} failed")
    return 1 if failed else 0


def problems(folder: Path) -> Iterator[Path]:
    """Yield the problems' folders by domain, in the order of the numbers in their names."""

    def by_number(place: Path) -> list[tuple[int, int, str]]:
        return [(1, int(part), "") if part.isdecimal() else (0, 0, part) for part in re.split(r"(\d+)", place.name)]

    for domain in sorted(place for place in folder.iterdir() if place.is_dir()) if folder.is_dir() else ():
        yield from sorted((file.parent for file in domain.glob("*/problem.pddl")), key=by_number)


def line(result: Result) -> str:
    """Return the result of one problem as a line of text."""
    text = f"{result.name:32}"
    if result.steps is not None:
        text += f" {result.steps:4} steps, cost {result.cost:g}, planned in {result.planning:.2f} s"
    if result.makespan is not None:
        text += f", makespan {result.makespan:g}, coordinated in {result.coordinating:.2f} s"
    if result.mishaps or result.leaver:
        text += f", {result.mishaps} mishaps{f', {result.leaver} left' if result.leaver else ''}, {result.plans} plans"
    return escape(text) + (f" [red]{escape(result.trouble)}[/red]" if result.trouble else "")


if __name__ == "__main__":
    sys.exit(main())

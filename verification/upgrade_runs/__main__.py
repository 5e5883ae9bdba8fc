"""Upgrades a system of the last release with running tasks, many times, and counts the tasks that continue.

    python -m verification.upgrade_runs [--runs 50] [--first 0] [--seed 17] [--out out/upgrade-runs]

The last line is `N passed, N failed`. A failed run leaves its data and its log in out/upgrade-runs/.
"""

from __future__ import annotations

import argparse
import asyncio
import shutil
import sys
from collections import deque
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from somrs.cli.import_commands import problem_of
from somrs.errors import SomrsError
from somrs.ontology.files.site import dump_site
from somrs.version import __version__
from verification.upgrade_runs.release import ROOT, build_release, release_name
from verification.upgrade_runs.run import Result, run

PARALLEL_SYSTEMS = 2
"""The number of systems that run at the same time."""


async def play(seeds: list[int], out_folder: Path, console: Console) -> list[Result]:
    """Play all seeds, and return their results."""
    release = build_release(ROOT / "out" / "releases")
    shutil.rmtree(out_folder, ignore_errors=True)
    out_folder.mkdir(parents=True)
    site = out_folder / "parcels.yaml"
    imported = problem_of([ROOT / "examples" / "parcels" / f"{name}.pddl" for name in ("domain", "problem")])
    site.write_text(dump_site(imported.ontology, imported.map, imported.name), encoding="utf-8")
    remaining, results = deque(seeds), list[Result]()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as bar:
        progress_task = bar.add_task(f"upgrades from {release_name()[0]} to {__version__}", total=len(seeds))

        async def work() -> None:
            while remaining:
                result = await run(remaining.popleft(), release, site, out_folder)
                results.append(result)
                if not result.problem:
                    shutil.rmtree(out_folder / f"{result.seed}", ignore_errors=True)
                bar.advance(progress_task)

        await asyncio.gather(*(work() for _ in range(min(PARALLEL_SYSTEMS, len(seeds)))))
    return sorted(results, key=lambda result: result.seed)


def summary(results: list[Result]) -> Table:
    table = Table(title="Upgrades with running tasks", title_justify="left")
    for name in ("seed", "killed after", "running tasks", "outcome"):
        table.add_column(name)
    for result in results:
        outcome = result.problem or ", ".join(sorted(set(result.ended.values())))
        table.add_row(f"{result.seed}", f"{result.killed_at:.1f} s", f"{result.task_count}", outcome)
    return table


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int)
    parser.add_argument("--out", type=Path, default=Path("out/upgrade-runs"))
    arguments = parser.parse_args()
    seeds = [arguments.seed] if arguments.seed is not None else [*range(arguments.first, arguments.first + arguments.runs)]
    console = Console()
    try:
        results = asyncio.run(play(seeds, arguments.out.resolve(), console))
    except SomrsError as error:
        print(error, file=sys.stderr)
        return 2
    console.print(summary(results))
    failed = [result for result in results if result.problem]
    print(f"{sum(result.task_count for result in results)} tasks were running")
    print(f"{len(results) - len(failed)} passed, {len(failed)} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

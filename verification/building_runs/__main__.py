"""`make building-runs`: imports buildings of Open-RMF, and has their robots deliver jars, or go to places; in every other run, a robot
breaks in a lift."""

from __future__ import annotations

import argparse
import asyncio
import shutil
import sys
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from somrs.cli.import_commands import import_sources
from somrs.errors import SomrsError
from somrs.ontology.files.loading import load
from verification.building_runs.errands import errands, further_robots
from verification.building_runs.run import Result, play

SITES = Path(__file__).parents[3] / "shared" / "sites"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m verification.building_runs", description=__doc__)
    parser.add_argument("buildings", type=Path, nargs="*", help="files for `somrs import`, or site files; by default, Open-RMF's")
    parser.add_argument("--runs", type=int, default=2, help="number of seeds for each building")
    parser.add_argument("--seed-base", type=int, default=0, help="the first seed")
    parser.add_argument("--tasks", type=int, default=10)
    parser.add_argument("--robots", type=int, default=4, help="number of robots that are put into a building without any")
    parser.add_argument("--out", type=Path, default=Path("out/building-runs"), help="the folder of the systems' data")
    chosen = parser.parse_args()
    console, passed, failed = Console(soft_wrap=True, highlight=False), 0, 0
    buildings = chosen.buildings or sorted(SITES.glob("*.building.yaml"))
    if not buildings:
        console.print(
            f"NOT TESTED: there are no buildings in {SITES}; name some, for example: python -m verification.building_runs site.yaml"
        )
    table = Table("building", "seed", "tasks", "across", "done", "waiting", "failed", "seconds", "broken in a lift")
    for building in buildings:
        folder = chosen.out / building.name.split(".")[0]
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        (site,) = import_sources([building], folder)
        site_map = load([site]).map
        has_lifts = site_map is not None and bool(site_map.facts("stopsAt"))
        for seed in range(chosen.seed_base, chosen.seed_base + chosen.runs):
            run_folder = folder / str(seed)
            run_folder.mkdir()
            try:
                whole_site = _with_robots(site, chosen.robots, seed, run_folder)
                tasks = errands(whole_site, chosen.tasks, seed)
                result = asyncio.run(play(whole_site, tasks, run_folder, breaks=has_lifts and seed % 2 == 1))
            except SomrsError as error:
                tasks, result = (), Result(problems=[str(error)])
            passed, failed = passed + (not result.problems), failed + bool(result.problems)
            counts = [sum(outcome == kind for outcome in result.outcomes.values()) for kind in ("accomplished", "failed")]
            crossing = sum(errand.crosses for errand in tasks)
            row = (len(tasks), crossing, counts[0], len(result.waiting), counts[1], round(result.simulated), result.broken or "")
            table.add_row(building.name.split(".")[0], str(seed), *map(str, row))
            for goal, outcome in result.outcomes.items():
                if outcome != "accomplished":
                    console.print(escape(f"{building.name}, seed {seed}: {goal}: {outcome}: {result.explanations[goal]}"))
            for goal, reason in result.waiting.items():
                console.print(escape(f"{building.name}, seed {seed}: {goal} waits: {reason}"))
            for problem in result.problems:
                console.print(f"[red]{escape(f'{building.name}, seed {seed}: {problem}')}[/red]; logs: {run_folder}/run/logs")
    console.print(table)
    console.print(f"{passed} passed, {failed} failed")
    return 1 if failed else 0


def _with_robots(site: Path, count: int, seed: int, folder: Path) -> tuple[Path, ...]:
    """The building, with robots in it."""
    robots, path = further_robots(site, count, seed), folder / "robots.yaml"
    if not robots:
        return (site,)
    path.write_text(robots)
    return site, path


if __name__ == "__main__":
    sys.exit(main())

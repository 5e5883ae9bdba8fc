"""`make energy-runs`: lets fleets with few chargers carry boxes for a long simulated time, and checks that no robot strands."""

from __future__ import annotations

import argparse
import asyncio
import shutil
import sys
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from verification.energy_runs.fleet import Fleet
from verification.energy_runs.run import EnergyRun

COLUMNS = (
    TextColumn("{task.description}"),
    BarColumn(),
    TextColumn("{task.completed:.1f} of {task.total:.0f} h, {task.fields[told]}"),
    TimeRemainingColumn(),
)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m verification.energy_runs", description=__doc__)
    parser.add_argument("--runs", type=int, default=1, help="number of seeds")
    parser.add_argument("--seed-base", type=int, default=0, help="the first seed")
    parser.add_argument("--hours", type=float, default=168.0, help="simulated hours of each run; a week by default")
    parser.add_argument("--robots", type=int, default=10)
    parser.add_argument("--chargers", type=int, default=3)
    parser.add_argument(
        "--spacing", type=float, default=40.0, help="the distance between two platforms, m; a week of short ways is much more work"
    )
    parser.add_argument("--lowest", type=int, default=25, help="the lowest charge at the beginning, percent")
    parser.add_argument("--highest", type=int, default=95, help="the highest charge at the beginning, percent")
    parser.add_argument("--speed", default="max", help="simulated seconds per second, or `max`")
    parser.add_argument("--out", type=Path, default=Path("out/energy-runs"), help="the folder of the systems' data")
    chosen = parser.parse_args()
    console, failed = Console(soft_wrap=True, highlight=False), 0
    for seed in range(chosen.seed_base, chosen.seed_base + chosen.runs):
        folder = chosen.out / str(seed)
        shutil.rmtree(folder, ignore_errors=True)
        fleet = Fleet(
            seed=seed,
            robots=chosen.robots,
            chargers=chosen.chargers,
            platforms=2 * chosen.robots + 1,  # so that there is a box and a free platform for each robot
            spacing=chosen.spacing,
            lowest_charge=chosen.lowest,
            highest_charge=chosen.highest,
        )
        run = EnergyRun(fleet, chosen.hours, folder, speed=chosen.speed, carried_at_once=chosen.robots)
        with Progress(*COLUMNS, console=console, transient=True) as bars:
            run.on_look = partial(bars.update, bars.add_task(f"seed {seed}", total=chosen.hours, told="starting"))
            result = asyncio.run(run.play())
        ends = ", ".join(f"{count} {outcome}" for outcome, count in result.outcomes.items())
        console.print(
            f"seed {seed}: {result.hours:.1f} h, tasks: {ends}, of which robots gave {result.charging_tasks} to charge; "
            f"lowest charge {result.lowest_charge:.0f} %"
        )
        for explanation in result.explanations[:5]:
            console.print(escape(f"  {explanation}"))
        if result.violation:
            failed += 1
            console.print(f"  [red]{escape(result.violation)}[/red]; logs: {folder}/run/logs")
    console.print(f"{chosen.runs - failed} passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

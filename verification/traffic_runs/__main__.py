"""`make traffic-runs`: plays many scenarios on all cores, or a single one with what the robots were told."""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from collections import Counter

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from somrs.protocol.messages.traffic import TripResult
from verification.traffic_runs.draw import draw
from verification.traffic_runs.play import Outcome, Play


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m verification.traffic_runs", description=__doc__)
    parser.add_argument("--runs", type=int, default=1000, help="number of seeds")
    parser.add_argument("--seed-base", type=int, default=0, help="the first seed")
    parser.add_argument("--seed", type=int, help="play only this seed, and print its messages")
    parser.add_argument("--jobs", type=int, default=multiprocessing.cpu_count(), help="processes")
    chosen = parser.parse_args()
    console = Console(soft_wrap=True, highlight=False)
    if chosen.seed is not None:
        return _report(chosen.seed, console)
    started_at, failed, results = time.perf_counter(), 0, Counter[TripResult]()
    columns = (TextColumn("traffic runs"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress, multiprocessing.Pool(chosen.jobs) as pool:
        bar = progress.add_task("", total=chosen.runs)
        for outcome in pool.imap_unordered(play, range(chosen.seed_base, chosen.seed_base + chosen.runs), chunksize=5):
            results.update(outcome.results)
            progress.update(bar, advance=1)
            if outcome.violation:
                failed += 1
                console.print(f"seed {outcome.seed}: [red]{escape(outcome.violation)}[/red]\n  make traffic-runs SEED={outcome.seed}")
    ends = ", ".join(f"{results[result]} {result}" for result in TripResult)
    console.print(f"{results.total()} trips: {ends}; {time.perf_counter() - started_at:.0f} s")
    console.print(f"{chosen.runs - failed} passed, {failed} failed")
    return 1 if failed else 0


def play(seed: int) -> Outcome:
    return Play(draw(seed)).run()


def _report(seed: int, console: Console) -> int:
    scenario = draw(seed)
    run = Play(scenario)
    outcome = run.run()
    for message in run.world.messages:
        console.print(escape(f"{message.header.sender:>8} > {message.header.recipient:8} {message.body}"))
    console.print(escape(f"{scenario.incidents}\n{outcome}"))
    return 1 if outcome.violation else 0


if __name__ == "__main__":
    sys.exit(main())

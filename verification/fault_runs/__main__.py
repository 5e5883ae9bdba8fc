"""`make fault-runs`: plays many scenarios on all cores, or a single one with a full report."""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from collections.abc import Iterator

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from verification.fault_runs.draw import draw
from verification.fault_runs.report import MessageLog, figures, report_lines
from verification.fault_runs.result import Result, play_scenario, run
from verification.fault_runs.scenario import Scenario
from verification.fault_runs.scenario_run import ScenarioRun
from verification.fault_runs.shrink import shrink_scenario
from verification.fault_runs.violation import Violation

PROGRESS_INTERVAL = 5000
"""The number of runs between two progress lines, when the output is a file."""

MAX_LISTED, MAX_REPORTED = 25, 5
"""The number of failing seeds that are listed, and of those that are reduced and reported."""


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m verification.fault_runs", description=__doc__)
    parser.add_argument("--runs", type=int, default=1000, help="number of seeds")
    parser.add_argument("--seed-base", type=int, default=0, help="the first seed")
    parser.add_argument("--seed", type=int, help="play only this seed, with a full report")
    parser.add_argument("--jobs", type=int, default=multiprocessing.cpu_count(), help="processes")
    chosen = parser.parse_args()
    console = Console(soft_wrap=True, highlight=False)
    if chosen.seed is not None:
        return _report_seed(chosen.seed, console)
    return _run(chosen.seed_base, chosen.runs, chosen.jobs, console)


def _run(base: int, count: int, jobs: int, console: Console) -> int:
    total, started_at = Result(), time.perf_counter()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        bar = progress.add_task("fault runs", total=count)
        for result in _results(range(base, base + count), jobs):
            total.add(result)
            rate = total.runs / (time.perf_counter() - started_at)
            progress.update(bar, advance=1, description=f"fault runs, {rate:.0f}/s, {len(total.failed)} failed")
            if not console.is_terminal and total.runs % PROGRESS_INTERVAL == 0:
                console.print(f"{total.runs} of {count} runs, {rate:.0f}/s, {len(total.failed)} failed")
            for seed, (property, description) in result.failed.items() if len(total.failed) <= MAX_LISTED else ():
                console.print(f"seed {seed}: [red]{property}[/red]: {escape(description)}\n  make fault-runs SEED={seed}")
    console.print(figures(total, time.perf_counter() - started_at))
    for seed in sorted(total.failed)[:MAX_REPORTED]:
        console.print(f"\n[bold]seed {seed}, reduced:[/bold]")
        console.print(escape(_shrink(seed).describe()))
    console.print(f"{total.runs - len(total.failed)} passed, {len(total.failed)} failed")
    return 1 if total.failed else 0


def _results(seeds: range, jobs: int) -> Iterator[Result]:
    if jobs <= 1:
        yield from map(run, seeds)
        return
    with multiprocessing.Pool(jobs) as pool:
        yield from pool.imap_unordered(run, seeds, chunksize=max(1, min(50, len(seeds) // (4 * jobs))))


def _shrink(seed: int) -> Scenario:
    """Return the shortest scenario found that violates the same property as the seed's scenario."""
    scenario = draw(seed)
    _, violation = play_scenario(scenario)
    if violation is None:
        return scenario

    def fails(candidate: Scenario) -> bool:
        _, candidate_violation = play_scenario(candidate)
        return candidate_violation is not None and candidate_violation.property is violation.property

    return shrink_scenario(scenario, fails)


def _report_seed(seed: int, console: Console) -> int:
    scenario = draw(seed)
    scenario_run, violation = _play_and_report(scenario, console)
    if violation is None:
        console.print(f"seed {seed}: {len(scenario_run.world.messages)} messages, {scenario_run.events} inputs\n1 passed, 0 failed")
        return 0
    short = _shrink(seed)
    if short != scenario:
        console.print("\n[bold]reduced:[/bold]")
        _play_and_report(short, console)
    console.print("0 passed, 1 failed")
    return 1


def _play_and_report(scenario: Scenario, console: Console) -> tuple[ScenarioRun, Violation | None]:
    """Play the scenario, and print its report."""
    scenario_run, message_log = ScenarioRun(scenario), MessageLog()
    scenario_run.add_listener(message_log.record)
    violation = None
    try:
        scenario_run.play()
    except Violation as error:
        violation = error
    console.print(escape(scenario.describe()))
    for line in report_lines(scenario_run, message_log):
        console.print(escape(line))
    if violation is not None:
        console.print(f"[red]{violation.property}[/red]: {escape(violation.description)}")
    return scenario_run, violation


if __name__ == "__main__":
    sys.exit(main())

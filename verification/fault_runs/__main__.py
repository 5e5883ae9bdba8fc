"""`make fault-runs`: many stories on both cores, or one of them told in full."""

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
from verification.fault_runs.properties import Violation
from verification.fault_runs.result import Result, played, run
from verification.fault_runs.shrink import shrunk
from verification.fault_runs.stage import Stage
from verification.fault_runs.story import Story
from verification.fault_runs.told import Ear, figures, log

TOLD_EVERY = 5000
"""Runs between two lines of a file that the progress is written to."""

MOST_NAMED, MOST_TOLD = 25, 5
"""So many failing seeds are named, and so many of them are made short and told."""


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m verification.fault_runs", description=__doc__)
    parser.add_argument("--runs", type=int, default=1000, help="how many seeds")
    parser.add_argument("--seed-base", type=int, default=0, help="the first of them")
    parser.add_argument("--seed", type=int, help="one seed only, told in full")
    parser.add_argument("--jobs", type=int, default=multiprocessing.cpu_count(), help="processes")
    chosen = parser.parse_args()
    console = Console(soft_wrap=True, highlight=False)
    if chosen.seed is not None:
        return _tell(chosen.seed, console)
    return _run(chosen.seed_base, chosen.runs, chosen.jobs, console)


def _run(base: int, count: int, jobs: int, console: Console) -> int:
    total, began = Result(), time.perf_counter()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        bar = progress.add_task("fault runs", total=count)
        for result in _results(range(base, base + count), jobs):
            total.add(result)
            rate = total.runs / (time.perf_counter() - began)
            progress.update(bar, advance=1, description=f"fault runs, {rate:.0f}/s, {len(total.failed)} failed")
            if not console.is_terminal and total.runs % TOLD_EVERY == 0:
                console.print(f"{total.runs} of {count} runs, {rate:.0f}/s, {len(total.failed)} failed")
            for seed, (property, seen) in result.failed.items() if len(total.failed) <= MOST_NAMED else ():
                console.print(f"seed {seed}: [red]{property}[/red]: {escape(seen)}\n  make fault-runs SEED={seed}")
    console.print(figures(total, time.perf_counter() - began))
    for seed in sorted(total.failed)[:MOST_TOLD]:
        console.print(f"\n[bold]seed {seed}, made as short as it can be:[/bold]")
        console.print(escape(_short(seed).words()))
    console.print(f"{total.runs - len(total.failed)} passed, {len(total.failed)} failed")
    return 1 if total.failed else 0


def _results(seeds: range, jobs: int) -> Iterator[Result]:
    if jobs <= 1:
        yield from map(run, seeds)
        return
    with multiprocessing.Pool(jobs) as pool:
        yield from pool.imap_unordered(run, seeds, chunksize=max(1, min(50, len(seeds) // (4 * jobs))))


def _short(seed: int) -> Story:
    """The shortest story that fails as the seed's does."""
    story = draw(seed)
    _, violation = played(story)
    if violation is None:
        return story

    def fails(candidate: Story) -> bool:
        _, found = played(candidate)
        return found is not None and found.property is violation.property

    return shrunk(story, fails)


def _tell(seed: int, console: Console) -> int:
    story = draw(seed)
    stage, violation = _heard(story, console)
    if violation is None:
        console.print(f"seed {seed}: {len(stage.world.messages)} messages, {stage.events} inputs\n1 passed, 0 failed")
        return 0
    short = _short(seed)
    if short != story:
        console.print("\n[bold]made as short as it can be:[/bold]")
        _heard(short, console)
    console.print("0 passed, 1 failed")
    return 1


def _heard(story: Story, console: Console) -> tuple[Stage, Violation | None]:
    """Play the story, and tell it."""
    stage, ear = Stage(story), Ear()
    stage.hears(ear.hear)
    violation = None
    try:
        stage.play()
    except Violation as found:
        violation = found
    console.print(escape(story.words()))
    for line in log(stage, ear):
        console.print(escape(line))
    if violation is not None:
        console.print(f"[red]{violation.property}[/red]: {escape(violation.seen)}")
    return stage, violation


if __name__ == "__main__":
    sys.exit(main())

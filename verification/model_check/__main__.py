"""`python -m verification.model_check` checks the protocol on all media; `--mutations` checks the check.

Closes with `N passed, N failed`, and fails when anything did.
"""

from __future__ import annotations

import argparse
import os
import sys
import time

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from verification.model_check.media import MEDIA
from verification.model_check.mutations import all_mutations, judge_all
from verification.model_check.properties import Property
from verification.model_check.suite import LOST_DISKS, Result, check_all, check_assumption

COLUMNS = 160

BOUNDS = (
    "One copy of a message is under way at a time, but on the duplicating medium, which delivers whatever the others can.",
    "Two participants, FIFO and lossy: senders repeat their oldest message first, as the nodes do that run; one participant: in any order.",
    "Two participants, or a lost disk: an order is too late when its participant is given up; else it may be so at any moment.",
    "An order is said again to one that it did not reach; that it comes again later is the duplicating medium's.",
    "A lost disk: one, once, with no other restarts; only property 3 is asked for, as nobody is held to what is forgotten.",
    "Property 5, the map tells the truth, is about the Task Manager's data and not in this model: it is checked in the fault runs.",
)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m verification.model_check", description="Checks the Failure Recovery Protocol.")
    parser.add_argument("--mutations", action="store_true", help="alter each entry of the tables in turn, and see whether a property falls")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1, help="for --mutations: how many at a time")
    options = parser.parse_args(arguments)
    console = Console(width=None if sys.stdout.isatty() else COLUMNS, highlight=False)
    passed, failed = _mutations(console, options.processes) if options.mutations else _properties(console)
    print(f"{passed} passed, {failed} failed")
    return 1 if failed else 0


def _bar(console: Console) -> Progress:
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    return Progress(*columns, console=console, transient=True)


def _properties(console: Console) -> tuple[int, int]:
    started_at = time.perf_counter()
    with _bar(console) as bar:
        task = bar.add_task("exploring", total=2 * len(MEDIA) + len(LOST_DISKS) + 2)

        def tick(states: int) -> None:
            bar.update(task, description=f"exploring: {states:,} states")

        results = []
        for result in check_all(tick):
            results.append(result)
            bar.advance(task)
        assumption_results = []
        for cut_off, clocks in ((False, True), (True, False)):
            assumption_results.append(check_assumption(cut_off=cut_off, clocks=clocks, tick=tick))
            bar.advance(task)
    console.print(table(results, "The Failure Recovery Protocol, in every state that can be reached"))
    console.print(table(assumption_results, "Without the timing assumption property 1 has to fall: it is no protocol's to keep"))
    for bound in BOUNDS:
        console.print(f"- {bound}")
    _print_charts(console, [*results, *assumption_results])
    cells = [counterexample for result in results for counterexample in result.cells.values()]
    failed = sum(broken is not None for broken in cells) + sum(
        result.cells[Property.MUTUAL_EXCLUSION] is None for result in assumption_results
    )
    console.print(f"{sum(result.states for result in results):,} states in {time.perf_counter() - started_at:.0f} s")
    return len(cells) + len(assumption_results) - failed, failed


def table(results: list[Result], title: str) -> Table:
    """Media by properties; a dash where a property was not looked for."""
    drawn = Table(title=title, title_justify="left")
    drawn.add_column("medium", no_wrap=True)
    drawn.add_column("with", no_wrap=True)
    for prop in Property:
        drawn.add_column(str(prop), justify="center")
    drawn.add_column("states", justify="right")
    drawn.add_column("s", justify="right")
    for result in results:
        cells = ["-" if prop not in result.cells else "holds" if result.cells[prop] is None else "FALLS" for prop in Property]
        drawn.add_row(result.medium, result.configuration, *cells, f"{result.states:,}", f"{result.seconds:.1f}")
    return drawn


def _print_charts(console: Console, results: list[Result]) -> None:
    for result in results:
        for prop, counterexample in result.cells.items():
            if counterexample is not None:
                console.print(f"\n{prop}: falls on {result.medium}, {result.configuration}")
                print("\n".join(counterexample.chart or [f"  => {counterexample.reason}"]))
    console.print()


def _mutations(console: Console, processes: int) -> tuple[int, int]:
    started_at = time.perf_counter()
    mutations = all_mutations()
    with _bar(console) as bar:
        task = bar.add_task("altering the tables", total=len(mutations))
        verdicts = []
        for verdict in judge_all(mutations, processes):
            verdicts.append(verdict)
            bar.advance(task)
    uncaught = [verdict for verdict in verdicts if not verdict.caught_by]
    drawn = Table("altered", "why no property notices", title="What no property notices", title_justify="left")
    for verdict in uncaught:
        drawn.add_row(str(verdict.mutation), verdict.explanation or "UNEXPLAINED")
    console.print(drawn)
    caught, explained = len(verdicts) - len(uncaught), sum(bool(verdict.explanation) for verdict in uncaught)
    stale = [verdict for verdict in verdicts if verdict.misexplained]
    for verdict in stale:
        console.print(
            f"{verdict.mutation}: the explanation is wrong: "
            f"{verdict.caught_by or ('it is used' if verdict.is_exercised else 'it is never met')}"
        )
    unexplained = len(uncaught) - explained
    console.print(f"{len(verdicts)} alterations in {time.perf_counter() - started_at:.0f} s")
    console.print(f"{caught} caught, {explained} explained, {unexplained} unexplained")
    return caught + explained - len(stale), unexplained + len(stale)


if __name__ == "__main__":
    sys.exit(main())

"""`python -m verification.model_check` checks the protocol on all media; `--mutations` checks the check.

The last line is `N passed, N failed`. The exit status is 1 if anything failed.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import time

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from verification.model_check import reservation_rules
from verification.model_check.mutations import all_mutations, judge_all
from verification.model_check.property import Property
from verification.model_check.reservation_check import reservation_checks, shared_reservation_checks
from verification.model_check.suite import Check, Result, assumption_checks, kind_checks, plain_checks, run_check

COLUMNS = 160

WIDE_TABLE = 9
"""The number of properties from which on a table has their numbers in place of their names, and signs in place of words."""

BOUNDS = (
    "One copy of a message is in transit at a time, except on the duplicating medium, which can deliver whatever the other media can.",
    "Two participants on a lossy FIFO: senders repeat their oldest message first, as nodes do. One participant: in any order.",
    "Two participants, or a lost disk: an order expires when its participant is given up. Otherwise it can expire at any moment.",
    "A new order is sent only to a participant that was not reached. Only the duplicating medium delivers an order a second time.",
    "Kinds of steps: one at a time, with one formula. Two participants of them: on the medium that can deliver whatever the others can.",
    "A new session follows when both sides have ended the one before. Beside one that has not ended, it is the second participant.",
    "A lost disk: one, once, without other restarts. Only property 3 is checked, as a side is not bound by what it has lost.",
    "Reservations: two tasks, which change two objects in opposite orders. Each is cancelled or tries again later at most once.",
    "Two Repositories: each lease ends at most once. Without delays, a Task Manager hears of its own Repository at once.",
    "With delays, one copy of what a Repository tells its Task Manager is in transit at a time, in order.",
    "Property 5, map correctness, concerns the Task Manager's data, which are not in this model. The fault runs check it.",
)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m verification.model_check", description="Checks the Failure Recovery Protocol.")
    parser.add_argument(
        "--mutations", action="store_true", help="alter each entry of the tables and each rule in turn, and check the properties"
    )
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1, help="number of parallel processes")
    options = parser.parse_args(arguments)
    console = Console(width=None if sys.stdout.isatty() else COLUMNS, highlight=False)
    passed, failed = _mutations(console, options.processes) if options.mutations else _properties(console, options.processes)
    print(f"{passed} passed, {failed} failed")
    return 1 if failed else 0


def _bar(console: Console) -> Progress:
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    return Progress(*columns, console=console, transient=True)


def _properties(console: Console, processes: int) -> tuple[int, int]:
    started_at = time.perf_counter()
    tables = [plain_checks(), kind_checks(), reservation_checks(), shared_reservation_checks(), assumption_checks()]
    # The last ones take longest, and begin first.
    results = _results([check for checks in reversed(tables) for check in reversed(checks)], console, processes)[::-1]
    plain_results, kind_results, reservation_results, shared_results, assumption_results = (
        [results.pop(0) for _ in checks] for checks in tables
    )
    console.print(table(plain_results, "The Failure Recovery Protocol in every reachable state"))
    console.print(table(kind_results, "Conditions, refusals for now, what has to hold meanwhile, and recognition"))
    console.print(f"({'; '.join(prop for prop in Property if prop.number)})")
    console.print(table(reservation_results, "Reservations of two Task Managers at one Repository"))
    console.print(table(shared_results, "Reservations of two Task Managers at two Repositories that are neighbours"))
    console.print(table(assumption_results, "Without the timing assumption property 1 has to fail: no protocol can ensure it"))
    for bound in BOUNDS:
        console.print(f"- {bound}")
    results = [*plain_results, *kind_results, *reservation_results, *shared_results]
    _print_charts(console, [*results, *assumption_results])
    cells = [counterexample for result in results for counterexample in result.cells.values()]
    failed = sum(broken is not None for broken in cells) + sum(
        result.cells[Property.MUTUAL_EXCLUSION] is None for result in assumption_results
    )
    console.print(f"{sum(result.states for result in results):,} states in {time.perf_counter() - started_at:.0f} s")
    return len(cells) + len(assumption_results) - failed, failed


def _results(checks: list[Check], console: Console, processes: int) -> list[Result]:
    """The results of the checks, in their order."""
    results = []
    with _bar(console) as bar, multiprocessing.get_context("spawn").Pool(processes) as pool:
        task = bar.add_task("exploring every state", total=len(checks))
        for result in pool.imap(run_check, checks):
            results.append(result)
            bar.advance(task)
    return results


def table(results: list[Result], title: str) -> Table:
    """A table of media by properties, with a dash for a property that was not checked."""
    drawn = Table(title=title, title_justify="left")
    drawn.add_column("medium", no_wrap=True)
    drawn.add_column("with", no_wrap=True)
    columns = [prop for prop in Property if any(prop in result.cells for result in results)]
    is_wide = len(columns) >= WIDE_TABLE
    for prop in columns:
        drawn.add_column((prop.number or "valid") if is_wide else str(prop), justify="center")
    drawn.add_column("states", justify="right", no_wrap=True)
    drawn.add_column("s", justify="right", no_wrap=True)
    holds, falls = ("✓", "✗") if is_wide else ("holds", "FALLS")
    for result in results:
        cells = ["-" if prop not in result.cells else holds if result.cells[prop] is None else falls for prop in columns]
        drawn.add_row(result.medium, result.configuration, *cells, f"{result.states:,}", f"{result.seconds:.1f}")
    return drawn


def _print_charts(console: Console, results: list[Result]) -> None:
    for result in results:
        for prop, counterexample in result.cells.items():
            if counterexample is not None:
                console.print(f"\n{prop}: violated on {result.medium}, {result.configuration}")
                print("\n".join(counterexample.chart or [f"  => {counterexample.reason}"]))
    console.print()


def _mutations(console: Console, processes: int) -> tuple[int, int]:
    started_at = time.perf_counter()
    mutations = all_mutations()
    with _bar(console) as bar:
        task = bar.add_task("mutating the tables", total=len(mutations))
        verdicts = []
        for verdict in judge_all(mutations, processes):
            verdicts.append(verdict)
            bar.advance(task)
    uncaught = [verdict for verdict in verdicts if not verdict.caught_by]
    drawn = Table("mutation", "explanation", title="Mutations that violate no property", title_justify="left")
    for verdict in uncaught:
        drawn.add_row(str(verdict.mutation), verdict.explanation or "UNEXPLAINED")
    console.print(drawn)
    caught, explained = len(verdicts) - len(uncaught), sum(bool(verdict.explanation) for verdict in uncaught)
    stale = [verdict for verdict in verdicts if verdict.misexplained]
    for verdict in stale:
        console.print(
            f"{verdict.mutation}: the explanation is wrong: "
            f"{verdict.caught_by or ('the entry is used' if verdict.is_exercised else 'the entry is not used')}"
        )
    unexplained = len(uncaught) - explained
    wrong_rules = {change: reservation_rules.find_violation(rule, wrong) for (rule, change), wrong in reservation_rules.RULES.items()}
    wrong_rules |= {
        change: reservation_rules.find_shared_violation(rule, owner, wrong)
        for (rule, change), (owner, wrong) in reservation_rules.SHARED_RULES.items()
    }
    for change in (change for change, violation in wrong_rules.items() if not violation):
        explanation = reservation_rules.EXPLANATIONS.get(change)
        console.print(f"reservations: {change}: violates no property: {explanation or 'UNEXPLAINED'}")
        explained, unexplained = explained + bool(explanation), unexplained + (not explanation)
    caught += sum(map(bool, wrong_rules.values()))
    console.print(f"{len(verdicts) + len(wrong_rules)} mutations in {time.perf_counter() - started_at:.0f} s")
    console.print(f"{caught} caught, {explained} explained, {unexplained} unexplained")
    return caught + explained - len(stale), unexplained + len(stale)


if __name__ == "__main__":
    sys.exit(main())

"""The results of many runs, in tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from statistics import median

from rich.console import Console
from rich.table import Table

from verification.kill_runs.draw import MESSAGES, Victim
from verification.kill_runs.run import Result


def summary(results: Sequence[Result], console: Console) -> None:
    """What came of all runs, by message and victim."""
    console.print(_by_message(results))
    console.print(_by_victim(results))
    for missed in (one for one in results if one.missed):
        console.print(
            f"[yellow]missed[/] seed {missed.seed}, attempt {missed.attempt + 1}: {missed.case}: {missed.missed}", highlight=False
        )
    for failed in (one for one in results if not one.missed and not one.recovered):
        console.print(f"[bold red]failed[/] seed {failed.seed}: {failed.case}", highlight=False)
        for problem in (*failed.problems, *(f"lost: {one}" for one in failed.lost)):
            console.print(f"    {problem}", highlight=False, markup=False)


def told(result: Result) -> str:
    """A run in a line."""
    what = "missed" if result.missed else "recovered" if result.recovered else "FAILED"
    return f"{what:>9} {result.took:5.1f} s  seed {result.seed}: {result.case}; {result.struck or 'nobody'} struck; {result.outcome}"


def _by_message(results: Sequence[Result]) -> Table:
    table = Table(title="Recovered of all, by message and by who is struck at it")
    for heading in ("message", *Victim, "missed"):
        table.add_column(heading, justify="left" if heading == "message" else "right")
    for heading in ("to the next message, s: p50", "max", "to the outcome, s: p50", "max", "acknowledged", "lost"):
        table.add_column(heading, justify="right")
    for message in MESSAGES:
        its = [one for one in results if one.message == message]
        if its:
            cells = [_share(one for one in its if one.victim == victim) for victim in Victim]
            table.add_row(message, *cells, *_figures(its))
    table.add_section()
    table.add_row("all", *[_share(one for one in results if one.victim == victim) for victim in Victim], *_figures(results))
    return table


def _by_victim(results: Sequence[Result]) -> Table:
    table = Table(title="By who is struck")
    for heading in ("victim", "runs", "recovered", "accomplished", "cancelled", "failed", "not known where a thing is", "missed"):
        table.add_column(heading, justify="left" if heading == "victim" else "right")
    for heading in ("to the next message, s: p50", "max", "to the outcome, s: p50", "max", "acknowledged", "lost"):
        table.add_column(heading, justify="right")
    for victim in Victim:
        its = [one for one in results if one.victim == victim]
        struck = [one for one in its if not one.missed]
        ends = [str(sum(one.outcome == end for one in struck)) for end in ("accomplished", "cancelled", "failed")]
        unknown = str(sum(bool(one.unknown) for one in struck))
        table.add_row(victim, str(len(struck)), str(sum(one.recovered for one in struck)), *ends, unknown, *_figures(its))
    return table


def _share(results: Iterable[Result]) -> str:
    struck = [one for one in results if not one.missed]
    good = sum(one.recovered for one in struck)
    return f"[{'green' if good == len(struck) else 'bold red'}]{good}/{len(struck)}[/]" if struck else "-"


def _figures(results: Sequence[Result]) -> list[str]:
    struck = [one for one in results if not one.missed]
    lost = sum(len(one.lost) for one in struck)
    return [
        str(sum(bool(one.missed) for one in results)),
        *_times(struck, lambda one: one.to_progress),
        *_times(struck, lambda one: one.to_outcome),
        str(sum(one.acknowledged for one in struck)),
        f"[bold red]{lost}[/]" if lost else "0",
    ]


def _times(results: Iterable[Result], time: Callable[[Result], float | None]) -> tuple[str, str]:
    found = [seconds for one in results if (seconds := time(one)) is not None]
    return (f"{median(found):.2f}", f"{max(found):.2f}") if found else ("-", "-")

"""Tables of the results of many runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from statistics import median

from rich.console import Console
from rich.table import Table

from verification.kill_runs.draw import MESSAGES, Victim
from verification.kill_runs.run import Result


def summary(results: Sequence[Result], console: Console, *, is_planned: bool = False) -> None:
    """Print the results of all runs by message and by victim."""
    console.print(_by_message(results))
    console.print(_by_victim(results))
    if take_overs := sorted(result.to_take_over for result in results if result.to_take_over is not None and not result.missed):
        late = take_overs[min(len(take_overs) - 1, math.ceil(len(take_overs) * 0.99) - 1)]
        figures = f"median {median(take_overs):.2f} s, 99 % within {late:.2f} s, most {take_overs[-1]:.2f} s"
        cause = "request to end to" if is_planned else "kill of"
        console.print(f"from the {cause} a host until its standbys lead: {figures}", highlight=False)
    for missed in (result for result in results if result.missed):
        console.print(
            f"[yellow]missed[/] seed {missed.seed}, attempt {missed.attempt + 1}: {missed.case}: {missed.missed}", highlight=False
        )
    for failed in (result for result in results if not result.missed and not result.recovered):
        console.print(f"[bold red]failed[/] seed {failed.seed}: {failed.case}", highlight=False)
        for problem in (*failed.problems, *(f"lost: {loss}" for loss in failed.lost)):
            console.print(f"    {problem}", highlight=False, markup=False)


def result_line(result: Result) -> str:
    """Return the result of a run as a line of text."""
    verdict = "missed" if result.missed else "recovered" if result.recovered else "FAILED"
    return f"{verdict:>9} {result.duration:5.1f} s  seed {result.seed}: {result.case}; victim {result.struck or 'none'}; {result.outcome}"


def _by_message(results: Sequence[Result]) -> Table:
    table = Table(title="Recovered runs, by message and victim")
    victims = [victim for victim in Victim if any(result.victim == victim for result in results)]
    for heading in ("message", *victims, "missed"):
        table.add_column(heading, justify="left" if heading == "message" else "right")
    for heading in ("to the next message, s: p50", "max", "to the outcome, s: p50", "max", "acknowledged", "lost"):
        table.add_column(heading, justify="right")
    for message in MESSAGES:
        matching = [result for result in results if result.message == message]
        if matching:
            cells = [_share(result for result in matching if result.victim == victim) for victim in victims]
            table.add_row(message, *cells, *_figures(matching))
    table.add_section()
    table.add_row("all", *[_share(result for result in results if result.victim == victim) for victim in victims], *_figures(results))
    return table


def _by_victim(results: Sequence[Result]) -> Table:
    table = Table(title="By victim")
    for heading in ("victim", "runs", "recovered", "accomplished", "cancelled", "failed", "place unknown", "missed"):
        table.add_column(heading, justify="left" if heading == "victim" else "right")
    for heading in ("to the next message, s: p50", "max", "to the outcome, s: p50", "max", "acknowledged", "lost"):
        table.add_column(heading, justify="right")
    for victim in Victim:
        matching = [result for result in results if result.victim == victim]
        if not matching:
            continue
        struck = [result for result in matching if not result.missed]
        ends = [str(sum(result.outcome == end for result in struck)) for end in ("accomplished", "cancelled", "failed")]
        unknown = str(sum(bool(result.unknown) for result in struck))
        table.add_row(victim, str(len(struck)), str(sum(result.recovered for result in struck)), *ends, unknown, *_figures(matching))
    return table


def _share(results: Iterable[Result]) -> str:
    struck = [result for result in results if not result.missed]
    good = sum(result.recovered for result in struck)
    return f"[{'green' if good == len(struck) else 'bold red'}]{good}/{len(struck)}[/]" if struck else "-"


def _figures(results: Sequence[Result]) -> list[str]:
    struck = [result for result in results if not result.missed]
    lost = sum(len(result.lost) for result in struck)
    return [
        str(sum(bool(result.missed) for result in results)),
        *_times(struck, lambda result: result.to_progress),
        *_times(struck, lambda result: result.to_outcome),
        str(sum(result.acknowledged for result in struck)),
        f"[bold red]{lost}[/]" if lost else "0",
    ]


def _times(results: Iterable[Result], time: Callable[[Result], float | None]) -> tuple[str, str]:
    durations = [seconds for result in results if (seconds := time(result)) is not None]
    return (f"{median(durations):.2f}", f"{max(durations):.2f}") if durations else ("-", "-")

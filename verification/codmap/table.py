"""A table of the results, with a row for each domain."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import mean, median

from rich.table import Table

from verification.codmap.result import Result


def table(results: Sequence[Result], seconds: float) -> Table:
    """Return the table. `seconds` is the duration of the whole run."""
    domain_table = Table(title=f"{len(results)} problems in {seconds / 60:.1f} min", title_justify="left")
    domain_table.add_column("domain")
    for title in (
        "solved",
        "passed",
        "out of reach",
        "steps",
        "plan cost",
        "makespan",
        "of the steps",
        "s to plan",
        "worst",
        "s to coordinate",
        "worst",
    ):
        domain_table.add_column(title, justify="right")
    domains = {result.domain: None for result in results}
    for domain in domains:
        domain_table.add_row(domain, *_row([result for result in results if result.domain == domain]))
    if len(domains) > 1:
        domain_table.add_section()
        domain_table.add_row("all", *_row(results))
    return domain_table


def _row(results: Sequence[Result]) -> list[str]:
    solved = [result for result in results if result.steps is not None]
    played = [result for result in solved if result.makespan is not None]
    return [
        f"{len(solved)} of {len(results)}",
        str(sum(not result.trouble for result in results)),
        str(sum(result.out_of_reach for result in results)),
        _total(result.steps for result in solved),
        _total(result.cost for result in solved),
        _total(result.makespan for result in played),
        f"{mean(result.makespan / result.steps for result in played if result.makespan and result.steps):.2f}"
        if any(result.steps for result in played)
        else "-",
        *_times([result.planning for result in solved]),
        *_times([result.coordinating for result in played]),
    ]


def _total(numbers: Iterable[float | None]) -> str:
    return f"{sum(number for number in numbers if number is not None):g}"


def _times(seconds: Sequence[float]) -> tuple[str, str]:
    """Return the median and the maximum."""
    return (f"{median(seconds):.2f}", f"{max(seconds):.1f}") if seconds else ("-", "-")

"""The commands `somrs thing ...`: what mapping files and descriptions of things become."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from somrs.cli.options import Json, fail

if TYPE_CHECKING:
    from somrs.adapters.things.report import ThingsReport

thing_app = typer.Typer(help="Lights, doors, lifts, heaters and sensors by mapping files.", no_args_is_help=True, rich_markup_mode=None)


@thing_app.callback()
def options() -> None:
    """Lights, doors, lifts, heaters and sensors by mapping files."""


@thing_app.command()
def check(
    file: Annotated[
        str,
        typer.Argument(
            help="A mapping file (.yaml), a W3C Thing Description (.json, or an address), or Home Assistant's discovery messages (.json).",
        ),
    ],
    uses: Annotated[list[Path], typer.Option(help="Further files with definitions, such as those of the site.")] = [],  # noqa: B006  # as typer does
    json: Json = False,
) -> None:
    """Say what a file would become: devices, attributes with their sources, services with their formulas, and what is missing.

    The exit status is 2 if there are problems.
    """
    from somrs.adapters.things.report import check_file
    from somrs.client import terminal
    from somrs.errors import InputError

    try:
        report = check_file(file, uses)
    except InputError as error:
        fail(str(error), 2)
    if json:
        terminal.print_json(report)
    else:
        _print(report)


def _print(report: ThingsReport) -> None:
    things = [(row.name, row.type, row.kind, row.availability) for row in report.things]
    if things:
        _print_table("Things", ("name", "type", "is", "works as said by"), things)
    attributes = [(row.thing, row.path, row.source, row.conversion, row.news) for row in report.attributes]
    if attributes:
        _print_table("Attributes", ("thing", "attribute", "source", "conversion", "is news"), attributes)
    services = [(row.thing, row.type, row.effect, row.messages, row.done_when, row.failed_when) for row in report.services]
    if services:
        _print_table("Services", ("thing", "service", "effect", "messages", "done when", "failed when"), services)
    for text in report.missing:
        print(f"not mapped: {text}")
    for text in report.oddities:
        print(f"warning: {text}")


def _print_table(title: str, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    from somrs.client import terminal

    terminal.console().print(terminal.table(title, headings, rows))

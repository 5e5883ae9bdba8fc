"""The commands `somrs ros2 ...`: whether bindings fit the robots."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from somrs.cli.options import Json, fail

if TYPE_CHECKING:
    from somrs.adapters.ros2.checking import EndpointRow

ros2_app = typer.Typer(help="Robots with ROS 2 by binding files.", no_args_is_help=True, rich_markup_mode=None)


@ros2_app.callback()
def options() -> None:
    """Robots with ROS 2 by binding files."""


@ros2_app.command()
def check(
    site: Annotated[list[Path], typer.Argument(help="The site's files, with `adapters: ros2:` in one of them.")],
    wait: Annotated[float, typer.Option(help="For how long to look for what is not there, in seconds.", min=0)] = 5.0,
    json: Json = False,
) -> None:
    """Say whether the robots have the topics, services and actions that their bindings name, with such types and fields. Robots have to
    run; nothing is sent to them.

    The exit status is 2 if there are problems.
    """
    import asyncio

    from somrs.adapters.ros2.checking import check_bindings
    from somrs.client import terminal
    from somrs.errors import InputError

    try:
        settings, folder = _settings(site)
        rows = asyncio.run(check_bindings(settings, folder, wait))
    except InputError as error:
        fail(str(error), 2)
    if json:
        terminal.print_json(rows)
    else:
        _print(rows)
    if any(row.problem for row in rows):
        raise typer.Exit(2)


def _settings(site: list[Path]) -> tuple[Mapping[str, Any], Path]:
    """The settings of the adapter, and the folder to which paths in them refer. Raises InputError."""
    from somrs.errors import InputError
    from somrs.ontology.files.loading import load

    entry = load(site).adapters.get("ros2")
    if entry is None:
        raise InputError(f"{', '.join(map(str, site))}: there is no `adapters: ros2:`; name the robots there, with their bindings")
    return entry.settings, entry.folder


def _print(rows: list[EndpointRow]) -> None:
    from somrs.client import terminal

    console = terminal.console()
    endpoints = ((row.robot, row.place, row.name, row.type, row.problem or "ok") for row in rows)
    console.print(terminal.table("Bindings", ("robot", "key", "name", "type", "is"), endpoints))
    count = sum(bool(row.problem) for row in rows)
    print(f"{count} problem{'s' if count != 1 else ''}")

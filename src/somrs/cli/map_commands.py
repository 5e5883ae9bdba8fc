"""The commands that query and change the map. Each imports what it needs when it runs, so that `--help` is fast."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from somrs.cli.ontology import DEFAULT_AUTHOR, Author, BeforeOption, Dry, Limit, undo
from somrs.cli.options import DEFAULT_FOLDER, Data, Formula, Json, awaited

map_app = typer.Typer(help="Query and change the map in the Repository.", no_args_is_help=True, rich_markup_mode=None)


@map_app.command()
def query(
    formula: Formula,
    limit: Annotated[int, typer.Option(min=1, max=1_000_000, help="Maximum number of results.")] = 100,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """List the objects for which a formula holds. The exit status is 1 if there are none."""
    from somrs.cli.commands import query as run

    sys.exit(awaited(run(formula, limit, data, json=json)))


@map_app.command()
def show(name: Annotated[str, typer.Argument(help="An object of the map.")], data: Data = DEFAULT_FOLDER, json: Json = False) -> None:
    """Show the attributes and facts of an object."""
    from somrs.cli.commands import show_object as run

    awaited(run(name, data, json=json))


@map_app.command()
def history(
    name: Annotated[str, typer.Argument(help="An object of the map.")],
    limit: Limit = 100,
    before: BeforeOption = None,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Show the history of an object, newest first, and who discovered it."""
    from somrs.cli.commands import history as run

    awaited(run(name, limit, before, data, json=json))


@map_app.command()
def update(
    situation: Annotated[str | None, typer.Argument(help="The situation, as a formula.", show_default=False)] = None,
    add: Annotated[
        list[str],
        typer.Option(
            "--add",
            metavar="NAME:TYPE",
            help="A new object, of which the situation has what it must have: --add Jar9:Jar 'Jar9 isOn Table1 AND Jar9.PositionX = 2 "
            "AND ...'. Can be given several times.",
        ),
    ] = [],  # noqa: B006  # typer requires a list as the default
    remove: Annotated[
        list[str], typer.Option("--remove", metavar="NAME", help="An object that is no longer there. Several times, too.")
    ] = [],  # noqa: B006  # as above
    author: Author = DEFAULT_AUTHOR,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Update the map with a situation, new objects, and objects that are gone."""
    from somrs.cli.commands import update as run

    awaited(run(situation, add, remove, author, data))


@map_app.command()
def events(limit: Limit = 20, before: BeforeOption = None, data: Data = DEFAULT_FOLDER, json: Json = False) -> None:
    """List the events of the map and the ontology, newest first, with author, time, and changes."""
    from somrs.cli.edit_commands import history as run

    awaited(run(limit, data, ontology=False, before_version=before, json=json))


map_app.command()(undo)


@map_app.command()
def rename(
    name: Annotated[str, typer.Argument(help="An object of the map.")],
    to: Annotated[str, typer.Argument(help="Its new name.")],
    author: Author = DEFAULT_AUTHOR,
    dry: Dry = False,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Rename an object and all references to it."""
    from somrs.cli.edit_commands import alter
    from somrs.protocol.messages.knowledge import RenameObject

    sys.exit(awaited(alter(RenameObject(name=name, to=to, author=author), data, dry=dry, json=json)))


@map_app.command()
def merge(
    name: Annotated[str, typer.Argument(help="An object of the map.")],
    into: Annotated[str, typer.Argument(help="The object that it is. Its name stays.")],
    author: Author = DEFAULT_AUTHOR,
    dry: Dry = False,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """State that two objects are one, such as one that a camera discovered and one that was known before."""
    from somrs.cli.edit_commands import alter
    from somrs.protocol.messages.knowledge import MergeObject

    sys.exit(awaited(alter(MergeObject(name=name, into=into, author=author), data, dry=dry, json=json)))


@map_app.command()
def export(
    out: Annotated[
        Path, typer.Argument(help="The file to write: YAML, or the lanes in the Layout Interchange Format (*.lif, *.lif.json).")
    ],
    source: Annotated[
        list[Path] | None, typer.Option("--from", help="Export the map in these files, not that of a running system.")
    ] = None,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Export the site as it is now, with its map, as a YAML file, or its lanes as a LIF file."""
    from somrs.cli.commands import export as run

    awaited(run(out, data, source or ()))

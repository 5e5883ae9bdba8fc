"""The commands about the ontology: `somrs ontology ...`, and what an author's name and a dry run are called on the command line."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from somrs.cli.options import DEFAULT_FOLDER, Data, Json, awaited

ontology_app = typer.Typer(
    help="Edit the ontology that the Repository keeps, and see what changed.", no_args_is_help=True, rich_markup_mode=None
)

Author = Annotated[str, typer.Option(help="Who does it.")]
Dry = Annotated[bool, typer.Option("--dry-run", help="Only say what would come of it. Exits with 1 when it could not be done.")]
Limit = Annotated[int, typer.Option(help="At most so many.")]
BeforeOption = Annotated[int | None, typer.Option(help="Only what happened before this version.")]
Version = Annotated[int, typer.Argument(help="The version whose changes are undone; `history` and `events` tell which there are.")]
SomeSection = Annotated[str, typer.Argument(metavar="KIND", help="attribute, relation, function, type or service.")]
DEFAULT_AUTHOR = "somebody at the command line"


@ontology_app.command()
def history(limit: Limit = 20, before: BeforeOption = None, data: Data = DEFAULT_FOLDER, json: Json = False) -> None:
    """What changed in the ontology, newest first: by whom, when, and what."""
    from somrs.cli.edit_commands import history as run

    awaited(run(limit, data, ontology=True, before_version=before, json=json))


@ontology_app.command()
def undo(version: Version, author: Author = DEFAULT_AUTHOR, dry: Dry = False, data: Data = DEFAULT_FOLDER, json: Json = False) -> None:
    """Bring back what a version changed, if nothing changed it since."""
    from somrs.cli.edit_commands import alter
    from somrs.protocol.messages.knowledge import Undo

    sys.exit(awaited(alter(Undo(version=version, author=author), data, dry=dry, json=json)))


@ontology_app.command()
def remove(
    section: SomeSection,
    names: Annotated[list[str], typer.Argument(help="What is removed.")],
    author: Author = DEFAULT_AUTHOR,
    dry: Dry = False,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Remove definitions that nothing needs."""
    from somrs.cli.edit_commands import alter, remove_definitions
    from somrs.cli.options import guarded

    alteration = guarded(lambda: remove_definitions(section, names, author))
    sys.exit(awaited(alter(alteration, data, dry=dry, json=json)))


@ontology_app.command()
def rename(
    section: SomeSection,
    name: Annotated[str, typer.Argument(help="What it is called.")],
    to: Annotated[str, typer.Argument(help="What it is to be called.")],
    author: Author = DEFAULT_AUTHOR,
    dry: Dry = False,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Give a definition another name, everywhere where it is spoken of."""
    from somrs.cli.edit_commands import alter, rename_definition
    from somrs.cli.options import guarded

    alteration = guarded(lambda: rename_definition(section, name, to, author))
    sys.exit(awaited(alter(alteration, data, dry=dry, json=json)))


@ontology_app.command()
def export(
    out: Annotated[Path, typer.Argument(help="The file to write: .yaml; or OWL 2: .ttl (Turtle), .rdf or .owl (RDF/XML).")],
    whole: Annotated[bool, typer.Option("--whole", help="Of YAML: with what the upper ontology has, too. OWL has it always.")] = False,
    map: Annotated[bool, typer.Option("--map", help="Of OWL: with the map's objects. `somrs map export` writes them as YAML.")] = False,
    shapes: Annotated[bool, typer.Option(help="Of OWL: with the rules for maps as SHACL shapes; editors of OWL need none.")] = True,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Write the ontology as it is now to a file."""
    from somrs.cli import edit_commands, owl_files

    if owl_files.is_owl(out):
        awaited(owl_files.export(out, data, map=map, shapes=shapes))
    else:
        awaited(edit_commands.export(out, data, whole=whole))


@ontology_app.command(name="import")
def import_(
    file: Annotated[Path, typer.Argument(help="A file with definitions: YAML, or OWL (.ttl, .rdf, .owl, .xml).")],
    map: Annotated[bool, typer.Option("--map", help="Of OWL: put its individuals on the map, too, as the file has them.")] = False,
    author: Author = DEFAULT_AUTHOR,
    dry: Dry = False,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Take over the definitions of a file: they are added, or replace those of the same names."""
    from somrs.cli import edit_commands, owl_files

    if owl_files.is_owl(file):
        sys.exit(awaited(owl_files.import_definitions(file, author, data, map=map, dry=dry, json=json)))
    sys.exit(awaited(edit_commands.import_definitions(file, author, data, dry=dry, json=json)))

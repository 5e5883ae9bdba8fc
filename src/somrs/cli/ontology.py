"""The commands `somrs ontology ...`, and the options for the author and for dry runs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from somrs.cli.options import DEFAULT_FOLDER, Data, Json, awaited

ontology_app = typer.Typer(help="Edit the ontology in the Repository, and show its history.", no_args_is_help=True, rich_markup_mode=None)

Author = Annotated[str, typer.Option(help="The author of the change.")]
Dry = Annotated[bool, typer.Option("--dry-run", help="Only print the consequences. The exit status is 1 if the change is not possible.")]
Limit = Annotated[int, typer.Option(min=1, max=1_000_000, help="Maximum number of events.")]
BeforeOption = Annotated[int | None, typer.Option(min=0, help="Only events before this version.")]
Version = Annotated[int, typer.Argument(help="The version to undo; `history` and `events` list the versions.")]
SomeSection = Annotated[str, typer.Argument(metavar="KIND", help="attribute, relation, function, type or service.")]
DEFAULT_AUTHOR = "user at the command line"


@ontology_app.command()
def history(limit: Limit = 20, before: BeforeOption = None, data: Data = DEFAULT_FOLDER, json: Json = False) -> None:
    """List the changes of the ontology, newest first, with author and time."""
    from somrs.cli.edit_commands import history as run

    awaited(run(limit, data, ontology=True, before_version=before, json=json))


@ontology_app.command()
def undo(version: Version, author: Author = DEFAULT_AUTHOR, dry: Dry = False, data: Data = DEFAULT_FOLDER, json: Json = False) -> None:
    """Undo the changes of a version, unless later versions have changed the same things."""
    from somrs.cli.edit_commands import alter
    from somrs.protocol.messages.knowledge import Undo

    sys.exit(awaited(alter(Undo(version=version, author=author), data, dry=dry, json=json)))


@ontology_app.command()
def remove(
    section: SomeSection,
    names: Annotated[list[str], typer.Argument(help="The names of the definitions.")],
    author: Author = DEFAULT_AUTHOR,
    dry: Dry = False,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Remove definitions that nothing depends on."""
    from somrs.cli.edit_commands import alter, remove_definitions
    from somrs.cli.options import guarded

    alteration = guarded(lambda: remove_definitions(section, names, author))
    sys.exit(awaited(alter(alteration, data, dry=dry, json=json)))


@ontology_app.command()
def rename(
    section: SomeSection,
    name: Annotated[str, typer.Argument(help="The name of the definition.")],
    to: Annotated[str, typer.Argument(help="Its new name.")],
    author: Author = DEFAULT_AUTHOR,
    dry: Dry = False,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Rename a definition and all references to it."""
    from somrs.cli.edit_commands import alter, rename_definition
    from somrs.cli.options import guarded

    alteration = guarded(lambda: rename_definition(section, name, to, author))
    sys.exit(awaited(alter(alteration, data, dry=dry, json=json)))


@ontology_app.command()
def export(
    out: Annotated[Path, typer.Argument(help="The file to write: .yaml; or OWL 2: .ttl (Turtle), .rdf or .owl (RDF/XML).")],
    whole: Annotated[bool, typer.Option("--whole", help="For YAML: include the upper ontology. OWL files always include it.")] = False,
    map: Annotated[bool, typer.Option("--map", help="For OWL: include the objects of the map. For YAML, use `somrs map export`.")] = False,
    shapes: Annotated[bool, typer.Option(help="For OWL: include the rules for maps as SHACL shapes. OWL editors do not need them.")] = True,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Export the ontology as it is now to a file."""
    from somrs.cli import edit_commands, owl_files

    if owl_files.is_owl(out):
        awaited(owl_files.export(out, data, map=map, shapes=shapes))
    else:
        awaited(edit_commands.export(out, data, whole=whole))


@ontology_app.command(name="import")
def import_(
    file: Annotated[Path, typer.Argument(help="A file with definitions: YAML, or OWL (.ttl, .rdf, .owl, .xml).")],
    map: Annotated[bool, typer.Option("--map", help="For OWL: also import the individuals as objects of the map.")] = False,
    author: Author = DEFAULT_AUTHOR,
    dry: Dry = False,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Import the definitions of a file. They are added, or replace those of the same names."""
    from somrs.cli import edit_commands, owl_files

    if owl_files.is_owl(file):
        sys.exit(awaited(owl_files.import_definitions(file, author, data, map=map, dry=dry, json=json)))
    sys.exit(awaited(edit_commands.import_definitions(file, author, data, dry=dry, json=json)))

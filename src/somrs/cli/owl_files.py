"""The implementations of the commands about OWL files."""

from __future__ import annotations

import sys
from pathlib import Path

from somrs.cli.edit_commands import alter
from somrs.cli.running_site import site_addresses
from somrs.client import terminal
from somrs.client.client import Client
from somrs.client.owl_change import OwlChange
from somrs.errors import UsageError
from somrs.ontology import owl
from somrs.protocol.messages.knowledge import UpdateMap

FORMATS = {".ttl": owl.Format.TURTLE, ".rdf": owl.Format.XML, ".owl": owl.Format.XML, ".xml": owl.Format.XML}
"""The format of a file, by the suffix of its name."""


def is_owl(file: Path) -> bool:
    return file.suffix.lower() in FORMATS


async def export(output: Path, data: Path, *, map: bool, shapes: bool) -> None:
    async with Client(await site_addresses(data)) as client:
        ontology, exported_map = await client.ontology(), await client.map() if map else None
    output.write_bytes(owl.export(ontology, exported_map, FORMATS[output.suffix.lower()], shapes=shapes))
    objects = f", {len(exported_map.objects)} objects" if exported_map is not None else ""
    print(f"{output}: {len(ontology.types)} types, {len(ontology.services)} service types{objects}")


async def import_definitions(file: Path, author: str, data: Path, *, map: bool, dry: bool, json: bool) -> int:
    """Import the definitions of an OWL file and, with `map`, its individuals as objects of the map. Returns the exit status."""
    async with Client(await site_addresses(data)) as client:
        ontology, current_map = await client.ontology(), await client.map() if map else None
    try:
        text = file.read_text("utf-8-sig")
    except UnicodeDecodeError:
        raise UsageError(f"{file}: is not a text in UTF-8; save it in this encoding") from None
    owl_content = owl.read(text, str(file), ontology)
    for note in owl_content.notes:
        print(note, file=sys.stderr)
    change = OwlChange(owl_content, ontology, author)
    changes = change.on_map(current_map, str(file)) if current_map is not None else ()
    code = await alter(change.define, data, dry=dry, json=json) if change.changes_ontology or not changes else 0
    if code or not changes:
        if owl_content.map.objects and not map:
            print(f"individuals in the file: {len(owl_content.map.objects)}; --map imports them as objects of the map", file=sys.stderr)
        return code
    if not dry:
        return await alter(UpdateMap(changes=changes, author=author), data, dry=False, json=json)
    for map_change in changes:
        print(f"on the map: {terminal.change(map_change)}")
    return 0

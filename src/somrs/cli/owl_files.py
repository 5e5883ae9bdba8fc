"""What an OWL file would change, and what the commands about OWL files do."""

from __future__ import annotations

import sys
from pathlib import Path

from somrs.cli.editing import alter
from somrs.client import terminal as show
from somrs.client.client import Addresses, Client
from somrs.errors import ModelError, Problem, UsageError
from somrs.ontology import owl
from somrs.ontology.conformance import violations_of
from somrs.ontology.naming import find, revised
from somrs.ontology.objects import Change, Map, differences, objects_of
from somrs.ontology.renaming import Renamer
from somrs.ontology.types import Ontology
from somrs.protocol.messages.knowledge import Define, Revision, UpdateMap
from somrs.repository.outcome import revision

FORMATS = {".ttl": owl.Format.TURTLE, ".rdf": owl.Format.XML, ".owl": owl.Format.XML, ".xml": owl.Format.XML}
"""How a file is written, by how its name ends."""


def is_owl(file: Path) -> bool:
    return file.suffix.lower() in FORMATS


class OwlChange:
    """What a file that was read changes in an ontology: `define` leads to it."""

    def __init__(self, found: owl.Read, ontology: Ontology, author: str, expected_version: int | None = None) -> None:
        self._found = found
        self._renamer = Renamer(found.renamings, ontology.extended(found.ontology))
        removed = tuple(what for what in found.removed if find(ontology, what) is not None)
        before = self._renamer.ontology(revised(ontology, removed, ()))
        self._after = before.extended(self._renamer.definition(one) for one in found.ontology)
        self.define = Define(
            definitions=(revision(before, self._after) or Revision()).after,
            removed=removed,
            renamed=found.renamings,
            author=author,
            expected_version=expected_version,
        )

    @property
    def changes_ontology(self) -> bool:
        return bool(self.define.removed or self.define.renamed or any(self.define.definitions.each()))

    def on_map(self, now: Map, file: str) -> tuple[Change, ...]:
        """How the file's individuals change the map, once the ontology is as it says: they are as it says, with the facts whose first
        argument they are; other objects stay. Raises ModelError when the map would not conform."""
        before, found = (map.changed(self._renamer.changes(map)) for map in (now, self._found.map))
        facts = [fact for fact in before.facts() if not fact.arguments or fact.arguments[0] not in found.objects]
        after = Map({**before.objects, **found.objects}.values(), [*facts, *found.facts()])
        changes = tuple(differences(before, after))
        broken = violations_of(after, self._after, {name for change in changes for name in objects_of(change)})
        if broken:
            raise ModelError([Problem(file=file, line=None, subject=one.subject, rule=one.rule, message=one.message) for one in broken])
        return changes


# Commands


async def export(out: Path, data: Path, *, map: bool, shapes: bool) -> None:
    async with Client(Addresses.read(data)) as client:
        ontology, wanted = await client.ontology(), await client.map() if map else None
    out.write_bytes(owl.export(ontology, wanted, FORMATS[out.suffix.lower()], shapes=shapes))
    objects = f", {len(wanted.objects)} objects" if wanted is not None else ""
    print(f"{out}: {len(ontology.types)} types, {len(ontology.services)} service types{objects}")


async def take_over(file: Path, author: str, data: Path, *, map: bool, dry: bool, json: bool) -> int:
    """Have the definitions of a file added, or put in place of those of the same names; and, with `map`, its objects on the map."""
    async with Client(Addresses.read(data)) as client:
        ontology, now = await client.ontology(), await client.map() if map else None
    try:
        text = file.read_text("utf-8-sig")
    except UnicodeDecodeError:
        raise UsageError(f"{file}: is no text in UTF-8; save it as such") from None
    found = owl.read(text, str(file), ontology)
    for note in found.notes:
        print(note, file=sys.stderr)
    change = OwlChange(found, ontology, author)
    changes = change.on_map(now, str(file)) if now is not None else ()
    code = await alter(change.define, data, dry=dry, json=json) if change.changes_ontology or not changes else 0
    if code or not changes:
        if found.map.objects and not map:
            print(f"individuals in it: {len(found.map.objects)}; --map puts them on the map as the file has them", file=sys.stderr)
        return code
    if not dry:
        return await alter(UpdateMap(changes=changes, author=author), data, dry=False, json=json)
    for one in changes:
        print(f"on the map: {show.change(one)}")
    return 0

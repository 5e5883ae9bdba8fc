"""The ontology and the map as OWL 2 files, with SHACL shapes: written for editors and validators, and taken over from them."""

from __future__ import annotations

import asyncio
import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import ParamSpec, TypeVar

from somrs.app.desk.ontology import Consequences, Imported, ImportOntology, OntologyDesk
from somrs.app.desk.operations import Document, operation
from somrs.errors import ModelError, Problem
from somrs.ontology import owl
from somrs.ontology.conformance import violations_of
from somrs.ontology.naming import find, revised
from somrs.ontology.objects import Change, Map, differences, objects_of
from somrs.ontology.renaming import Renamer
from somrs.ontology.types import Ontology
from somrs.protocol.knowledge import Define, Revision, UpdateMap
from somrs.repository.outcome import revision

P = ParamSpec("P")
T = TypeVar("T")

MEDIA_TYPES = {owl.Format.TURTLE: "text/turtle; charset=utf-8", owl.Format.XML: "application/rdf+xml"}
ENDINGS = {owl.Format.TURTLE: "ttl", owl.Format.XML: "rdf"}

MUCH = 300
"""Objects from which on a process of its own does the work, so that nobody else waits for it."""
LONG = 400_000
"""Characters of a file likewise."""


class ImportedOwl(Imported, frozen=True, kw_only=True):
    """`notes`: what the file says besides, which was not taken over, and what to do about it. `on_map`: how its individuals change the
    map; of long lists the first are told. `objects`: how many individuals there are in it."""

    notes: tuple[Problem, ...] = ()
    objects: int = 0
    on_map: tuple[Change, ...] = ()
    all_on_map: int = 0


MOST_TOLD = 200
"""Changes of the map that are told."""


class OwlDesk(OntologyDesk):
    """The ontology with all its files."""

    @operation("GET", "/ontology/export.ttl")
    async def export_owl(self, format: owl.Format = owl.Format.TURTLE, map: bool = False, shapes: bool = True) -> Document:
        """The ontology in OWL 2 with its rules as SHACL shapes, as Turtle or RDF/XML; with the map, if that is wanted."""
        context = self._context
        wanted = context.map if map else None
        content = await _beside(
            wanted is not None and len(wanted.objects) > MUCH, owl.export, context.ontology, wanted, format, shapes=shapes
        )
        name = f"{'site' if map else 'ontology'}.{ENDINGS[format]}"
        return Document(content=content, media_type=MEDIA_TYPES[format], name=name)

    @operation("POST", "/ontology/import.owl")
    async def import_owl(self, body: ImportOntology, dry: bool = False, map: bool = False) -> ImportedOwl:
        """Take over the definitions of a Turtle or RDF/XML file: they are added, or replace those of the same names.

        One whose label was changed is renamed, one that is deprecated (owl:deprecated) is removed; what is not in the file stays.

        With `map`, its individuals are put on the map, too: what the file says of an object counts. `dry`: only say what would come of it.
        """
        ontology = self._context.ontology
        found = await _beside(len(body.text) > LONG, owl.read, body.text, body.file, ontology)
        define, after, renamer = _change(ontology, found, body)
        consequences = await self._consequences(define)
        changes: tuple[Change, ...] = ()
        if map:
            before = _renamed(self._context.map, renamer)
            changes = _on_map(before, _renamed(found.map, renamer))
            _check(before, changes, after, body.file)
        version = None if dry else await self._carry_out(define, changes, consequences)
        return ImportedOwl(
            consequences=consequences,
            version=version,
            notes=found.notes,
            objects=len(found.map.objects),
            on_map=changes[:MOST_TOLD],
            all_on_map=len(changes),
        )

    async def _carry_out(self, define: Define, changes: tuple[Change, ...], consequences: Consequences) -> int:
        """First the ontology, as the objects may need it."""
        version = consequences.version
        if consequences.revision or not changes:
            version = await self._context.client.define(define)
        if changes:
            version = await self._context.client.update(UpdateMap(changes=changes, author=define.author))
        return version


def _change(ontology: Ontology, found: owl.Read, body: ImportOntology) -> tuple[Define, Ontology, Renamer]:
    """The change that leads to what the file says, the ontology after it, and what it renames."""
    renamer = Renamer(found.renamings, ontology.extended(found.ontology))
    removed = tuple(what for what in found.removed if find(ontology, what) is not None)
    before = renamer.ontology(revised(ontology, removed, ()))
    after = before.extended(renamer.definition(one) for one in found.ontology)
    change = revision(before, after) or Revision()
    define = Define(
        definitions=change.after,
        removed=removed,
        renamed=found.renamings,
        author=body.author,
        expected_version=body.expected_version,
    )
    return define, after, renamer


def _renamed(map: Map, renamer: Renamer) -> Map:
    return map.changed(renamer.changes(map))


def _on_map(now: Map, file: Map) -> tuple[Change, ...]:
    """What leads to a map on which the file's objects are as it says, with the facts whose first argument they are; others stay."""
    facts = [fact for fact in now.facts() if not fact.arguments or fact.arguments[0] not in file.objects]
    after = Map({**now.objects, **file.objects}.values(), [*facts, *file.facts()])
    return tuple(differences(now, after))


def _check(before: Map, changes: tuple[Change, ...], ontology: Ontology, file: str) -> None:
    """Raises ModelError when the map would not conform."""
    objects = {name for change in changes for name in objects_of(change)}
    broken = violations_of(before.changed(changes), ontology, objects)
    if broken:
        raise ModelError([Problem(file=file, line=None, subject=one.subject, rule=one.rule, message=one.message) for one in broken])


async def _beside(much: bool, work: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Have it done while the event loop goes on; what is much, in another process, as a thread would slow everybody down."""
    task = partial(work, *args, **kwargs)
    if not much:
        return await asyncio.to_thread(task)
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as process:
        return await asyncio.get_running_loop().run_in_executor(process, task)

"""The ontology and the map as OWL 2 files, with SHACL shapes: written for editors and validators, and taken over from them."""

from __future__ import annotations

import asyncio
import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import ParamSpec, TypeVar

from somrs.api.ontology import ImportOntology, ImportResult, OntologyService
from somrs.client.operations import Document, operation
from somrs.client.owl_change import OwlChange
from somrs.errors import Problem
from somrs.ontology import owl
from somrs.ontology.objects import Change
from somrs.protocol.messages.knowledge import UpdateMap

P = ParamSpec("P")
T = TypeVar("T")

MEDIA_TYPES = {owl.Format.TURTLE: "text/turtle; charset=utf-8", owl.Format.XML: "application/rdf+xml"}
ENDINGS = {owl.Format.TURTLE: "ttl", owl.Format.XML: "rdf"}

LARGE_MAP = 300
"""Objects from which on a process of its own does the work, so that nobody else waits for it."""
LARGE_FILE = 400_000
"""Characters of a file likewise."""


class OwlImportResult(ImportResult, frozen=True, kw_only=True):
    """`notes`: what the file says besides, which was not taken over, and what to do about it. `on_map`: how its individuals change the
    map; of long lists the first are told. `objects`: how many individuals there are in it."""

    notes: tuple[Problem, ...] = ()
    objects: int = 0
    on_map: tuple[Change, ...] = ()
    all_on_map: int = 0


MAX_REPORTED_CHANGES = 200
"""Changes of the map that are told."""


class OwlService(OntologyService):
    """The ontology with all its files."""

    @operation("GET", "/ontology/export.ttl")
    async def export_owl(self, format: owl.Format = owl.Format.TURTLE, map: bool = False, shapes: bool = True) -> Document:
        """The ontology in OWL 2 with its rules as SHACL shapes, as Turtle or RDF/XML; with the map, if that is wanted."""
        context = self._context
        exported_map = context.map if map else None
        content = await _run_in_background(
            exported_map is not None and len(exported_map.objects) > LARGE_MAP,
            owl.export,
            context.ontology,
            exported_map,
            format,
            shapes=shapes,
        )
        name = f"{'site' if map else 'ontology'}.{ENDINGS[format]}"
        return Document(content=content, media_type=MEDIA_TYPES[format], name=name)

    @operation("POST", "/ontology/import.owl")
    async def import_owl(self, body: ImportOntology, dry: bool = False, map: bool = False) -> OwlImportResult:
        """Take over the definitions of a Turtle or RDF/XML file: they are added, or replace those of the same names.

        One whose label was changed is renamed, one that is deprecated (owl:deprecated) is removed; what is not in the file stays.

        With `map`, its individuals are put on the map, too: what the file says of an object counts. `dry`: only say what would come of it.
        """
        ontology = self._context.ontology
        owl_content = await _run_in_background(len(body.text) > LARGE_FILE, owl.read, body.text, body.file, ontology)
        change = OwlChange(owl_content, ontology, body.author, body.expected_version)
        consequences = await self._consequences(change.define)
        changes = change.on_map(self._context.map, body.file) if map else ()
        version = None if dry else await self._carry_out(change, changes)
        return OwlImportResult(
            consequences=consequences,
            version=version,
            notes=owl_content.notes,
            objects=len(owl_content.map.objects),
            on_map=changes[:MAX_REPORTED_CHANGES],
            all_on_map=len(changes),
        )

    async def _carry_out(self, change: OwlChange, changes: tuple[Change, ...]) -> int:
        """First the ontology, as the objects may need it."""
        client, version = self._context.client, self._context.version
        if change.changes_ontology or not changes:
            version = await client.define(change.define)
        return await client.update(UpdateMap(changes=changes, author=change.define.author)) if changes else version


async def _run_in_background(is_large: bool, work: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Have it done while the event loop goes on; what is much, in another process, as a thread would slow everybody down."""
    task = partial(work, *args, **kwargs)
    if not is_large:
        return await asyncio.to_thread(task)
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as process:
        return await asyncio.get_running_loop().run_in_executor(process, task)

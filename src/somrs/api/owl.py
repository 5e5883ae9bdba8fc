"""Export and import of the ontology and the map as OWL 2 files with SHACL shapes, for ontology editors and validators."""

from __future__ import annotations

import asyncio
import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import ParamSpec, TypeVar

from somrs.access.rights import Right
from somrs.api.ontology import ImportOntology, ImportResult, OntologyService
from somrs.client.operations import Document, operation
from somrs.client.owl_change import OwlChange
from somrs.errors import Problem
from somrs.ontology import owl
from somrs.ontology.objects import Change
from somrs.protocol.messages.knowledge import UpdateMap

P = ParamSpec("P")
T = TypeVar("T")

_MEDIA_TYPES = {owl.Format.TURTLE: "text/turtle; charset=utf-8", owl.Format.XML: "application/rdf+xml"}
_ENDINGS = {owl.Format.TURTLE: "ttl", owl.Format.XML: "rdf"}

LARGE_MAP = 300
"""Number of objects above which a separate process does the work, so that other requests do not wait."""
LARGE_FILE = 400_000
"""Number of characters of a file above which a separate process does the work."""


class OwlImportResult(ImportResult, frozen=True, kw_only=True):
    """The result of an OWL import. `notes`: statements of the file that were not imported, and what to do about them; `objects`: the number
    of individuals in the file; `on_map`: the changes of the map, cut if there are many; `all_on_map`: their full count."""

    notes: tuple[Problem, ...] = ()
    objects: int = 0
    on_map: tuple[Change, ...] = ()
    all_on_map: int = 0


MAX_REPORTED_CHANGES = 200
"""Maximum number of changes of the map in a result."""


class OwlService(OntologyService):
    """The operations on the ontology, including its OWL files."""

    @operation("GET", "/ontology/export.ttl", Right.SEE)
    async def export_owl(self, format: owl.Format = owl.Format.TURTLE, map: bool = False, shapes: bool = True) -> Document:
        """Export the ontology in OWL 2, as Turtle or RDF/XML; with `shapes`, its rules as SHACL shapes; with `map`, the map too."""
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
        name = f"{'site' if map else 'ontology'}.{_ENDINGS[format]}"
        return Document(content=content, media_type=_MEDIA_TYPES[format], name=name)

    @operation("POST", "/ontology/import.owl", Right.MODEL)
    async def import_owl(self, body: ImportOntology, dry: bool = False, map: bool = False) -> OwlImportResult:
        """Import the definitions of a Turtle or RDF/XML file: they are added, or replace those of the same names.

        A definition with a changed label is renamed, and a deprecated definition (owl:deprecated) is removed. Definitions that are not in
        the file stay.

        With `map`, the individuals of the file become objects of the map, and replace those of the same names. `dry`: only report the
        consequences.
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
        """Change the ontology first, since the objects may need the new definitions."""
        client, version = self._context.client, self._context.version
        if change.changes_ontology or not changes:
            version = await client.define(change.define)
        return await client.update(UpdateMap(changes=changes, author=change.define.author)) if changes else version


async def _run_in_background(is_large: bool, work: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Run `work` outside the event loop: in a thread, or in a process if it is large, since a thread would hold the interpreter lock."""
    task = partial(work, *args, **kwargs)
    if not is_large:
        return await asyncio.to_thread(task)
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as process:
        return await asyncio.get_running_loop().run_in_executor(process, task)

"""The ontology: reading, changes and their consequences, history, export and import."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import msgspec

from somrs.access.rights import Right
from somrs.api.context import Context
from somrs.api.definition_uses import DefinitionUse, find_definition_uses, find_obsolete_definitions
from somrs.api.orders import OrderService
from somrs.client.operations import Document, operation
from somrs.ontology.consistency import ontology_violations
from somrs.ontology.dependency_index import required_definitions
from somrs.ontology.files.dump import dump_ontology
from somrs.ontology.files.levels import level_of
from somrs.ontology.files.loading import load_definitions, upper
from somrs.ontology.naming import DefinitionKey, Renaming
from somrs.ontology.objects import Change
from somrs.ontology.types import Ontology
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.knowledge import BrokenRule, Define, Defined, Definitions, Events, ReadEvents, Revision, Undo, by_kind
from somrs.repository.ontology_diff import diff_ontologies
from somrs.repository.outcome import apply_revision

_YAML = "application/yaml"


class OntologyView(msgspec.Struct, frozen=True, kw_only=True):
    """A version of the ontology: all its definitions. `required_definition_keys` (JSON: `relied`): those that SO-MRS itself requires, which
    cannot be removed or renamed."""

    version: int
    definitions: Definitions
    required_definition_keys: tuple[DefinitionKey, ...] = msgspec.field(default=(), name="relied")


class BrokenOffer(msgspec.Struct, frozen=True, kw_only=True):
    """A service on offer that the planner could no longer use, and why."""

    service: str
    provider: str
    problem: str


class Consequences(msgspec.Struct, frozen=True, kw_only=True):
    """The consequences of a change of the ontology.

    `broken`: rules that the change would break; if there are any, the change is refused. `offers`: services on offer that the planner
    could no longer use. `affected`: running tasks, orders and templates with names that would no longer exist; they stay as they are.
    `revision`: the changed definitions; `changes`: the changes of the map. Long lists are cut; `all_broken` and `all_changes` are the
    full counts.
    """

    version: int
    broken: tuple[BrokenRule, ...] = ()
    revision: Revision | None = None
    changes: tuple[Change, ...] = ()
    all_broken: int = 0
    all_changes: int = 0
    offers: tuple[BrokenOffer, ...] = ()
    affected: tuple[DefinitionUse, ...] = ()


class ImportOntology(msgspec.Struct, frozen=True, kw_only=True):
    """The text of an ontology file: its definitions are added, or replace those of the same names. `expected_version`: as for other
    changes; `file`: the name of the file in messages about mistakes."""

    text: str
    author: str = ""
    expected_version: int | None = None
    file: str = "the file"


class ImportResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result of an import. `consequences`: as computed before the change; `version`: the version with the change, None for a dry
    run."""

    consequences: Consequences
    version: int | None = None


class OntologyService:
    def __init__(self, context: Context, orders: OrderService) -> None:
        self._context = context
        self._orders = orders

    @operation("GET", "/ontology", Right.SEE)
    async def read(self, version: int | None = None) -> OntologyView:
        """Read the whole ontology as it is now, or as it was at a version."""
        ontology, now = self._context.ontology, self._context.version
        if version is not None and version != now:
            ontology, now = await self._context.client.ontology(version), version
        return OntologyView(version=now, definitions=by_kind(ontology), required_definition_keys=required_definitions(ontology))

    @operation("POST", "/ontology/changes", Right.MODEL)
    async def change(self, body: Define) -> Defined:
        """Remove, rename, and add or replace definitions, in this order: all changes or none.

        With `expected_version`, the request is refused if a definition that it concerns has changed since that version.
        """
        return Defined(version=await self._context.client.define(body))

    @operation("POST", "/ontology/consider", Right.SEE)
    async def consider(self, body: Define) -> Consequences:
        """Report the consequences of a change of the ontology, without making it."""
        return await self._consequences(body)

    @operation("POST", "/ontology/undo/{version}", Right.MODEL)
    async def undo(self, version: int, author: str = "") -> Defined:
        """Undo the changes of a version, unless later versions have changed the same things."""
        return Defined(version=await self._context.client.undo(version, author))

    @operation("POST", "/ontology/undo/{version}/consider", Right.SEE)
    async def consider_undo(self, version: int) -> Consequences:
        """Report the consequences of undoing a version, without doing it."""
        return await self._consequences(Undo(version=version))

    @operation("GET", "/ontology/history", Right.SEE)
    async def history(self, before: int | None = None, limit: int = 100) -> Events:
        """Read the changes of the ontology, newest first: author, time, and the definitions before and after."""
        return await self._context.client.read_events(ReadEvents(before=before, limit=limit, ontology=True))

    @operation("GET", "/ontology/export.yaml", Right.SEE)
    async def export_yaml(self, whole: bool = False) -> Document:
        """Export the ontology as a YAML file: without the upper ontology, or with `whole` all of it."""
        text = dump_ontology(self._context.ontology, upper(level_of(self._context.ontology)), "ontology", whole=whole)
        return Document(content=text.encode(), media_type=_YAML, name="ontology.yaml")

    @operation("POST", "/ontology/import.yaml", Right.MODEL)
    async def import_yaml(self, body: ImportOntology, dry: bool = False) -> ImportResult:
        """Import the definitions of a YAML file; `dry`: only report the consequences."""
        return await self.import_definitions(load_definitions(body.text, body.file, self._context.ontology), body, dry)

    async def import_definitions(self, ontology: Ontology, request: ImportOntology, dry: bool) -> ImportResult:
        """Change the current ontology to `ontology`; `dry`: only report the consequences."""
        define = diff_ontologies(self._context.ontology, ontology, request.author, request.expected_version)
        consequences = await self._consequences(define)
        return ImportResult(consequences=consequences, version=None if dry else await self._context.client.define(define))

    async def _consequences(self, change: Define | Undo) -> Consequences:
        outcome = await self._context.client.consider(change)
        offers = tuple(_broken_offers(self._context.ontology, outcome.revision, await self._context.client.services()))
        users = tuple(await self._find_definition_uses(change, outcome.revision))
        return Consequences(**{name: getattr(outcome, name) for name in outcome.__struct_fields__}, offers=offers, affected=users)

    async def _find_definition_uses(self, change: Define | Undo, revision: Revision | None) -> Iterator[DefinitionUse]:
        words = find_obsolete_definitions(
            revision, change.renamed if isinstance(change, Define) else await self._reverse_renamings(change.version)
        )
        if not words:
            return iter(())
        tasks = await self._context.client.tasks(running=True)
        return find_definition_uses(words, self._context.ontology, tasks, *await self._orders.read_all())

    async def _reverse_renamings(self, version: int) -> list[Renaming]:
        """The renamings that undo those of the version."""
        events = (await self._context.client.read_events(ReadEvents(before=version + 1, limit=1, ontology=True))).events
        renamed = (renaming for event in events if event.version == version for renaming in event.renamed)
        return [Renaming(section=renaming.section, name=renaming.to, to=renaming.name) for renaming in renamed]


def _broken_offers(ontology: Ontology, change: Revision | None, offers: Iterable[Offer]) -> Iterator[BrokenOffer]:
    """The services on offer that the planner can use now and could not use after the change, with the reason."""
    ontology_after = apply_revision(ontology, change) if change is not None else ontology
    for offer in offers if change is not None else ():
        violations_before = set(map(str, ontology_violations(ontology, (offer.service_type,))))
        broken = [
            violation for violation in ontology_violations(ontology_after, (offer.service_type,)) if str(violation) not in violations_before
        ]
        if broken:
            yield BrokenOffer(service=offer.service, provider=offer.provider, problem=broken[0].message)

"""The outcome of a change of the map or of the ontology, and the messages that report it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from msgspec import structs

from somrs.ontology.conformance import Violation
from somrs.ontology.map import Map
from somrs.ontology.naming import DefinitionKey, Renaming, Section, find_definition, key_of, revise_ontology
from somrs.ontology.objects import Change, ObjectAdded, ObjectRemoved, ValueSet, objects_of
from somrs.ontology.types import UNKNOWN, Definition, Ontology
from somrs.protocol.messages.knowledge import BrokenRule, Considered, Definitions, Merging, OntologyChanged, Rejected, Revision, by_kind
from somrs.protocol.messages.observations import Discovery, Reception
from somrs.protocol.messages.paging import PAGE_BYTES, PAGE_ITEMS, fit_page
from somrs.repository.provenance import Aspect, Provenance, aspects_of

SITUATION, VERSION = "situation", "version"
"""Parts of a request that a violation may refer to."""

MAX_PROBLEMS = 50
"""The maximum number of problems in one message."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The map and the ontology after a change, and the smallest set of changes that leads there (empty for a change without effect).

    A change with `broken` rules must not be applied. The other fields are then filled only as far as they could be computed.

    `at`: when the change held, in seconds since 1970; None: now. `aspects`: what it is news about. `reception`: what became of a report.
    `merged`: objects that turned out to be others.
    """

    map: Map
    ontology: Ontology
    changes: tuple[Change, ...] = ()
    revision: Revision | None = None
    renamed: tuple[Renaming, ...] = ()
    broken: tuple[Violation, ...] = ()
    at: float | None = None
    aspects: tuple[Aspect, ...] = ()
    reception: Reception | None = None
    merged: tuple[Merging, ...] = ()

    @property
    def objects(self) -> tuple[str, ...]:
        """The names of the changed objects, each once."""
        changed = (name for change in self.changes for name in objects_of(change))
        return tuple(dict.fromkeys((*changed, *(merging.into for merging in self.merged))))

    @property
    def subjects(self) -> tuple[str, ...]:
        """The objects that the changes are about, each once: when a jar leaves a table, that is news of the jar."""
        return tuple(dict.fromkeys(objects_of(change)[0] for change in self.changes))

    @property
    def altered(self) -> tuple[str, ...]:
        """The subjects without those of which it only became doubtful, or certain again, what the map has of them."""
        altering = (change for change in self.changes if not (isinstance(change, ValueSet) and change.path == UNKNOWN))
        return tuple(dict.fromkeys(objects_of(change)[0] for change in altering))

    @property
    def definitions(self) -> tuple[DefinitionKey, ...]:
        """The changed definitions, under their old and their new names."""
        if self.revision is None:
            return ()
        return tuple(
            dict.fromkeys(
                key_of(definition) for definition in (*self.revision.before.all_definitions(), *self.revision.after.all_definitions())
            )
        )

    def with_changes_of(self, rest: Outcome) -> Outcome:
        """The outcome as far as it is `rest`. What it is news about, and what became of a report, stay."""
        return replace(self, map=rest.map, changes=rest.changes, broken=rest.broken)

    def with_superseded(self, parts: tuple[str, ...]) -> Outcome:
        """The outcome of a report of which these parts are older, too, than what the map has."""
        reception = self.reception or Reception()
        return replace(self, reception=structs.replace(reception, superseded=(*reception.superseded, *parts))) if parts else self

    def change_notice(self, version: int) -> OntologyChanged:
        """The notification that subscribers receive about a change of the ontology."""
        definitions = self.revision.after if self.revision is not None else Definitions()
        removed = tuple(definition_key for definition_key in self.definitions if find_definition(self.ontology, definition_key) is None)
        return OntologyChanged(definitions=definitions, version=version, removed=removed, changes=self.changes, renamed=self.renamed)


def revision(ontology_before: Ontology, ontology_after: Ontology) -> Revision | None:
    """The revision that turns the first ontology into the second; None when they are equal."""
    old, new = (
        by_kind(differing_definitions(ontology_before, ontology_after)),
        by_kind(differing_definitions(ontology_after, ontology_before)),
    )
    return Revision(before=old, after=new) if old != new else None


def apply_revision(ontology: Ontology, revision: Revision) -> Ontology:
    """The ontology after the revision. The order of the definitions is the same for every component that applies it."""
    return _replace_definitions(ontology, revision.before, revision.after)


def revert_revision(ontology: Ontology, revision: Revision) -> Ontology:
    """The ontology before the revision."""
    return _replace_definitions(ontology, revision.after, revision.before)


def _replace_definitions(ontology: Ontology, old: Definitions, new: Definitions) -> Ontology:
    new_keys = set(map(key_of, new.all_definitions()))
    return revise_ontology(
        ontology,
        (definition_key for definition_key in map(key_of, old.all_definitions()) if definition_key not in new_keys),
        new.all_definitions(),
    )


def differing_definitions(ontology: Ontology, other_ontology: Ontology) -> Iterator[Definition]:
    """The definitions of the first ontology that the second lacks or defines differently."""
    for definition in ontology:
        theirs = find_definition(other_ontology, key_of(definition))
        if theirs is not definition and theirs != definition:
            yield definition


def rejected(broken: Iterable[Violation], version: int) -> Rejected:
    """The Rejected message: each problem once, at most `MAX_PROBLEMS` of them."""
    violations = list(dict.fromkeys(broken))
    texts = list(dict.fromkeys(map(_problem_text, violations)))
    if len(texts) > MAX_PROBLEMS:
        texts[MAX_PROBLEMS:] = [f"and {len(texts) - MAX_PROBLEMS} more problems"]
    return Rejected(problems=tuple(texts), version=version, broken=tuple(map(broken_rule, violations[:MAX_PROBLEMS])))


def _problem_text(violation: Violation) -> str:
    """The violation as text for people. A violation of the situation or version needs no subject: the request has only one of each."""
    return violation.message if violation.section in (SITUATION, VERSION) else str(violation)


def considered(outcome: Outcome, version: int) -> Considered:
    """The Considered message: the outcome, cut to the size of a message."""
    room = PAGE_BYTES // 4
    broken = list(dict.fromkeys(outcome.broken))
    full_revision = outcome.revision
    return Considered(
        version=version,
        broken=tuple(fit_page(map(broken_rule, broken), PAGE_ITEMS, room)),
        revision=Revision(before=_limit_definitions(full_revision.before, room), after=_limit_definitions(full_revision.after, room))
        if full_revision is not None
        else None,
        changes=tuple(fit_page(outcome.changes, PAGE_ITEMS, room)),
        all_broken=len(broken),
        all_changes=len(outcome.changes),
    )


def _limit_definitions(definitions: Definitions, room: int) -> Definitions:
    return by_kind(fit_page(definitions.all_definitions(), PAGE_ITEMS, room))


def broken_rule(violation: Violation) -> BrokenRule:
    return BrokenRule(
        subject=violation.subject, rule=violation.rule, message=violation.message, path=violation.path, section=violation.section
    )


def note_provenance(provenance: Provenance, outcome: Outcome, map: Map, author: str, now: float) -> None:
    """Note an outcome that becomes the state of the Repository. `map`: the map before it."""
    at = outcome.at if outcome.at is not None else now
    renamed = {renaming.name: renaming.to for renaming in outcome.renamed if renaming.section is Section.OBJECTS}
    for name, to in renamed.items():
        provenance.rename(name, to)
    merged = {merging.name: merging.into for merging in outcome.merged}
    for name, into in merged.items():
        provenance.merge(map.objects[name], into)
    for change in outcome.changes:
        if isinstance(change, ObjectRemoved) and change.name not in renamed and change.name not in merged:
            provenance.remove(map.objects[change.name], at)
        elif isinstance(change, ObjectAdded):
            provenance.add(change.object)
    if outcome.reception is not None:
        for name in outcome.reception.added:
            provenance.discoveries[name] = Discovery(author=author, at=at)
    if outcome.at is not None:
        provenance.note(outcome.aspects, at)
    elif outcome.revision is None and not outcome.renamed and not outcome.merged:  # an undo holds from now on
        provenance.note((aspect for change in outcome.changes for aspect in aspects_of(change, outcome.ontology)), at)

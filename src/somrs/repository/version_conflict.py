"""Optimistic concurrency: detects that a change affects objects or definitions that changed after the expected version."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from somrs.ontology.conformance import Violation
from somrs.ontology.naming import DefinitionKey, find_definition, key_of
from somrs.protocol.messages.knowledge import Alteration, Define, MergeObject, RenameObject, Undo, UpdateMap
from somrs.protocol.messages.people import person_name
from somrs.repository.outcome import VERSION, Outcome
from somrs.repository.state import Contents


def version_conflicts(alteration: Alteration, outcome: Outcome, contents: Contents) -> Iterator[Violation]:
    """The changed objects and definitions that changed after the expected version. Undo requests have no expected version."""
    if isinstance(alteration, Undo) or alteration.expected_version is None:
        return
    expected = alteration.expected_version
    if expected > contents.version:
        message = f"version {expected} does not exist yet, the latest is {contents.version}: read it again"
        yield Violation(subject=VERSION, rule="overtaken", message=message, section=VERSION)
        return
    match alteration:
        case Define():
            yield from _definitions(alteration, expected, contents)
        case RenameObject(name=name):
            yield from _objects([name], expected, contents)
        case MergeObject(name=name, into=into):
            yield from _objects([name, into], expected, contents)
        case UpdateMap():
            yield from _objects(outcome.subjects, expected, contents)


def _definitions(define: Define, expected: int, contents: Contents) -> Iterator[Violation]:
    changed = (
        key_of(definition)
        for definition in define.definitions.all_definitions()
        if find_definition(contents.ontology, key_of(definition)) != definition
    )
    renamed = (DefinitionKey(section=renaming.section, name=renaming.name) for renaming in define.renamed)
    for definition_key in dict.fromkeys((*define.removed, *renamed, *changed)):
        latest = contents.last_change(definition_key)
        if latest is not None and latest.version > expected:
            is_now = "changed" if find_definition(contents.ontology, definition_key) is not None else "removed or renamed"
            message = (
                f"{person_name(latest.author)} {is_now} it in version {latest.version}, after version {expected} that was expected; "
                "read it again before you change it"
            )
            yield Violation(subject=definition_key.name, rule="overtaken", message=message, section=definition_key.section)


def _objects(names: Iterable[str], expected: int, contents: Contents) -> Iterator[Violation]:
    for name in dict.fromkeys(names):
        version = contents.changed_at.get(name, 0)
        if version > expected:
            message = f"changed in version {version}, after version {expected} that was expected; read it again before you change it"
            yield Violation(subject=name, rule="overtaken", message=message)

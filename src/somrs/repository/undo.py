"""Undoes a version: computes the reverse change, or the later changes that prevent it.

A change of the ontology is undone by another one that restores the old definitions and reverses the renamings. The reversed renamings also
apply to definitions and objects added since. A change of the map is undone by the inverse changes.
"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import structs

from somrs.ontology.conformance import Violation
from somrs.ontology.naming import DefinitionKey, Section, find_definition, key_of
from somrs.ontology.objects import Change, FactAdded, FactRemoved, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.renaming import Renamer
from somrs.ontology.types import Definition
from somrs.protocol.messages.knowledge import Define, Event, RenameObject, Revision, by_kind
from somrs.protocol.messages.people import person_name
from somrs.repository.definition import define_outcome, rename_outcome
from somrs.repository.outcome import Outcome
from somrs.repository.state import Contents
from somrs.repository.update import changes_outcome


def undo_outcome(event: Event, contents: Contents) -> Outcome:
    """The outcome of undoing the event now."""
    map, ontology = contents.map, contents.ontology
    renamed = [renaming for renaming in event.renamed if renaming.section is Section.OBJECTS]
    if renamed:
        (renaming,) = renamed  # an event renames at most one object, and nothing else
        return rename_outcome(map, ontology, RenameObject(name=renaming.to, to=renaming.name))
    if event.revision is not None:
        define, broken = _definitions(event, event.revision, contents)
        return define_outcome(map, ontology, define) if not broken else Outcome(map=map, ontology=ontology, broken=tuple(broken))
    if broken := [*_map_conflicts(event, contents)]:
        return Outcome(map=map, ontology=ontology, broken=tuple(broken))
    return changes_outcome(map, ontology, event.before)


def _definitions(event: Event, revision: Revision, contents: Contents) -> tuple[Define, list[Violation]]:
    """The change of the ontology that undoes the event, and the conflicts with later changes."""
    renamer = Renamer(event.renamed, contents.ontology)
    # A definition whose name was taken over is restored after its successor has its old name again.
    targets = {DefinitionKey(section=renaming.section, name=renaming.to) for renaming in event.renamed}
    targets -= {DefinitionKey(section=renaming.section, name=renaming.name) for renaming in event.renamed}
    restored: list[Definition] = [definition for definition in revision.before.all_definitions() if key_of(definition) in targets]
    old_definitions = {
        renamer.renamed_key(key_of(definition)): definition
        for definition in revision.before.all_definitions()
        if key_of(definition) not in targets
    }
    new_definitions = {key_of(definition): definition for definition in revision.after.all_definitions()}
    broken: list[Violation] = []
    for definition_key in {**old_definitions, **new_definitions}:
        old, new, now = (
            old_definitions.get(definition_key),
            new_definitions.get(definition_key),
            find_definition(contents.ontology, definition_key),
        )
        if old is not None and renamer.definition(old) == new:
            continue  # the reversed renamings restore it
        if now != new:
            broken.append(_conflict_violation(event, definition_key, _changed_since(definition_key, new is None, now is None, contents)))
        if old is not None:
            restored.append(old)
    removed = tuple(definition_key for definition_key in new_definitions if definition_key not in old_definitions)
    reverse_renamings = tuple(structs.replace(renaming, name=renaming.to, to=renaming.name) for renaming in event.renamed)
    return Define(removed=removed, renamed=reverse_renamings, definitions=by_kind(restored)), broken


def _changed_since(definition_key: DefinitionKey, was_absent: bool, is_absent: bool, contents: Contents) -> str:
    if is_absent:
        return f"the {definition_key} is not there any more"
    if was_absent:
        return f"there is a {definition_key} again; remove it or rename it first"
    latest = contents.last_change(definition_key)
    author_note = f" by {person_name(latest.author)} in version {latest.version}; undo that first" if latest is not None else ""
    return f"the {definition_key} was changed since{author_note}"


def _conflict_violation(event: Event, definition_key: DefinitionKey, message: str) -> Violation:
    full_message = f"version {event.version} cannot be undone: {message}"
    return Violation(subject=definition_key.name, rule="changed-since", message=full_message, section=definition_key.section)


# The map


def _map_conflicts(event: Event, contents: Contents) -> Iterator[Violation]:
    for change in event.changes:
        subject, message = _map_difference(change, event, contents)
        if message:
            version = contents.changed_at.get(subject, 0)
            hint = f"; {subject} changed in version {version}: undo that first" if version > event.version else ""
            message = f"version {event.version} cannot be undone: {message}{hint}"
            yield Violation(subject=subject, rule="changed-since", message=message)


def _map_difference(change: Change, event: Event, contents: Contents) -> tuple[str, str]:
    """The subject of a change, and how the map now differs from the change's result (empty when it does not differ)."""
    map = contents.map
    match change:
        case ValueSet(name, path, value):
            object = map.objects.get(name)
            if object is None:
                return name, f"{name} is not on the map any more"
            now = object.values.get(path)
            is_unchanged = now == value and isinstance(now, bool) == isinstance(value, bool)
            return name, "" if is_unchanged else f"{path} was {_format_value(value)} after it, and is {_format_value(now)} now"
        case ObjectAdded(object):
            name = object.name
            if name not in map.objects:
                return name, f"{name} is not on the map any more"
            if map.objects[name] != object:
                return name, f"{name} was changed since"
            new_facts = [fact for fact in map.facts_about(name) if FactAdded(fact) not in event.changes]
            if new_facts and ObjectRemoved(name) in event.before:
                return name, f"{new_facts[0]} was added since, and cannot hold without {name}"
            return name, ""
        case ObjectRemoved(name):
            return name, f"there is a {name} on the map again" if name in map.objects else ""
        case FactAdded(fact):
            return fact.arguments[0], "" if map.has_fact(fact.relation, fact.arguments) else f"{fact} does not hold any more"
        case FactRemoved(fact):
            return fact.arguments[0], f"{fact} holds again" if map.has_fact(fact.relation, fact.arguments) else ""


def _format_value(value: float | str | bool | None) -> str:
    return "not given" if value is None else f"{value:g}" if isinstance(value, float) else str(value)

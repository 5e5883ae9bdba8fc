"""Computes the outcome of a change of the ontology: the new ontology, the new map, and the rules that they break."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator

from msgspec import structs

from somrs.entish.parse import nearest
from somrs.ontology.affected_objects import violations_after
from somrs.ontology.conformance import Violation
from somrs.ontology.consistency import ontology_violations
from somrs.ontology.dependency_index import lost_dependencies
from somrs.ontology.map import Map
from somrs.ontology.naming import SINGULAR, DefinitionKey, Renaming, Section, find_definition, key_of, revise_ontology, section_of
from somrs.ontology.renaming import Renamer, speaks_of
from somrs.ontology.types import Ontology
from somrs.protocol.messages.knowledge import Define, RenameObject
from somrs.repository.names import is_name, text_problem, texts
from somrs.repository.outcome import Outcome, apply_revision, differing_definitions, revision


def define_outcome(map: Map, ontology: Ontology, define: Define) -> Outcome:
    """The outcome of a change of the ontology."""
    if impossible := (*_impossible(ontology, define), *_text_violations(define)):
        return Outcome(map=map, ontology=ontology, broken=impossible)
    renamer = Renamer(define.renamed, ontology)
    remaining_ontology = revise_ontology(ontology, define.removed, ())
    ontology_after = revise_ontology(renamer.ontology(remaining_ontology), (), define.definitions.all_definitions())
    changes = tuple(renamer.changes(map)) if define.renamed else ()
    map_after = map.changed(changes)
    broken = [*lost_dependencies(ontology, ontology_after), *_inconsistencies(ontology, ontology_after, define)]
    if replaced := [*_replaced(define)]:  # statements about the removed definition must not silently apply to its successor
        broken += [
            *violations_after(map, ontology, remaining_ontology, replaced),
            *_adopted(ontology, remaining_ontology, define, replaced),
        ]
    # A formula that does not fit the ontology cannot be evaluated.
    sound = _without_broken_formulas(ontology_after, broken)
    renamed_ontology = renamer.ontology(ontology)
    broken += violations_after(
        map_after,
        renamed_ontology,
        sound,
        (
            key_of(definition)
            for definition in (
                *differing_definitions(renamed_ontology, ontology_after),
                *differing_definitions(ontology_after, renamed_ontology),
            )
        ),
    )
    change = revision(ontology, ontology_after)
    return Outcome(
        map=map_after,
        ontology=apply_revision(ontology, change) if change is not None else ontology,
        changes=changes,
        revision=change,
        renamed=define.renamed,
        broken=tuple(dict.fromkeys(broken)),
    )


def rename_outcome(map: Map, ontology: Ontology, rename: RenameObject) -> Outcome:
    """The outcome of renaming an object. The ontology changes as well if it refers to the object."""
    if impossible := tuple(_impossible_object(map, ontology, rename)):
        return Outcome(map=map, ontology=ontology, broken=impossible)
    renaming = Renaming(section=Section.OBJECTS, name=rename.name, to=rename.to)
    renamer = Renamer((renaming,), ontology)
    changes, change = tuple(renamer.changes(map)), revision(ontology, renamer.ontology(ontology))
    ontology_after = apply_revision(ontology, change) if change is not None else ontology
    return Outcome(map=map.changed(changes), ontology=ontology_after, changes=changes, revision=change, renamed=(renaming,))


def _inconsistencies(ontology: Ontology, ontology_after: Ontology, define: Define) -> Iterator[Violation]:
    """The violations in the ontology after the change. An earlier version may have accepted what this one does not: such a definition can
    stay as it is."""
    if violations := ontology_violations(ontology_after):
        defined = {(section_of(definition), definition.name) for definition in define.definitions.all_definitions()}
        earlier = {*ontology_violations(ontology)}
        yield from (v for v in violations if v not in earlier or (v.section, v.subject) in defined)


def _replaced(define: Define) -> Iterator[DefinitionKey]:
    """The removed definitions whose names other definitions take over."""
    targets = {(renaming.section, renaming.to) for renaming in define.renamed}
    return (definition_key for definition_key in define.removed if (definition_key.section, definition_key.name) in targets)


def _adopted(ontology: Ontology, remaining_ontology: Ontology, define: Define, replaced: Iterable[DefinitionKey]) -> Iterator[Violation]:
    """Violations for definitions that refer to a removed definition, and would refer to the one that takes over its name."""
    renamer = Renamer(define.renamed, ontology)
    new_definitions = {key_of(definition): definition for definition in define.definitions.all_definitions()}
    for definition_key in replaced:
        for definition in remaining_ontology:
            renamed_definition = renamer.definition(definition)
            renamed_key = key_of(renamed_definition)
            if new_definitions.get(renamed_key, renamed_definition) == renamed_definition and speaks_of(
                definition, definition_key, ontology
            ):
                message = (
                    f"refers to the {definition_key} that is removed, and would refer to the one that takes over its name; "
                    "change it first, or in the same change"
                )
                yield Violation(subject=renamed_key.name, rule="replaced", message=message, section=renamed_key.section)


def _without_broken_formulas(ontology: Ontology, broken: Iterable[Violation]) -> Ontology:
    names = {violation.subject for violation in broken if violation.section == Section.TYPES and violation.path.startswith("constraints")}
    object_types = [ontology.types[name] for name in names if name in ontology.types]
    return ontology.extended(structs.replace(type, constraints=()) for type in object_types) if object_types else ontology


# Requests that are impossible


def _wrong(subject: DefinitionKey | Renaming, rule: str, message: str) -> Violation:
    return Violation(subject=subject.name, rule=rule, message=message, section=subject.section)


def _impossible(ontology: Ontology, define: Define) -> Iterator[Violation]:
    for definition_key in define.removed:
        if definition_key.section is Section.OBJECTS:
            yield _wrong(definition_key, "section", "an object is removed by an update of the map, not by a change of the ontology")
        elif find_definition(ontology, definition_key) is None:
            yield _wrong(definition_key, "unknown-name", _unknown(definition_key, ontology))
    yield from _wrong_renamings(ontology, define)
    key_counts = Counter(map(key_of, define.definitions.all_definitions()))
    for definition_key, count in key_counts.items():
        yield from _unusable(definition_key, definition_key.name)
        if count > 1:
            yield _wrong(definition_key, "duplicate", f"is defined {count} times in this change; keep one")


def _text_violations(define: Define) -> Iterator[Violation]:
    for definition in define.definitions.all_definitions():
        for path, text in texts(definition):
            if message := text_problem(text):
                yield Violation(subject=definition.name, rule="text", message=message, path=path, section=section_of(definition))


def _wrong_renamings(ontology: Ontology, define: Define) -> Iterator[Violation]:
    renamings = define.renamed
    leaving = {(renaming.section, renaming.name) for renaming in renamings} | {
        (definition_key.section, definition_key.name) for definition_key in define.removed
    }
    arriving = Counter((renaming.section, renaming.to) for renaming in renamings)
    for renaming in renamings:
        if renaming.section is Section.OBJECTS:
            yield _wrong(renaming, "section", "is not renamed with the ontology; an object of the map is renamed by itself")
            continue
        source = DefinitionKey(section=renaming.section, name=renaming.name)
        if find_definition(ontology, source) is None or source in define.removed:
            yield _wrong(renaming, "unknown-name", _unknown(renaming, ontology))
        yield from _unusable(renaming, renaming.to)
        target = DefinitionKey(section=renaming.section, name=renaming.to)
        if find_definition(ontology, target) is not None and (renaming.section, renaming.to) not in leaving:
            yield _wrong(renaming, "duplicate", f"cannot be renamed: there is a {target} already; take another name")
        elif arriving[renaming.section, renaming.to] > 1:
            yield _wrong(renaming, "duplicate", f"cannot be renamed: another definition is renamed to {renaming.to} too; take another name")
    for (section, name), count in Counter((renaming.section, renaming.name) for renaming in renamings).items():
        if count > 1:
            yield Violation(subject=name, rule="duplicate", message=f"is renamed {count} times; give it one new name", section=section)


def _impossible_object(map: Map, ontology: Ontology, rename: RenameObject) -> Iterator[Violation]:
    object = map.objects.get(rename.name)
    if object is None:
        hint = nearest(rename.name, map.similar_names(rename.name)) or "add it first"
        yield Violation(subject=rename.name, rule="unknown-object", message=f"there is no object {rename.name} on the map; {hint}")
    elif ontology.is_device(object.type):
        message = "is a device, and its program uses this name; remove it from the map, and let it join under another name"
        yield Violation(subject=rename.name, rule="device", message=message)
    if rename.to in map.objects:
        message = f"cannot be called {rename.to}: an object of this name is on the map already; take another name"
        yield Violation(subject=rename.name, rule="duplicate", message=message)
    else:
        # Definitions may still refer to a removed object of the new name. They would then refer to the renamed object.
        for definition in ontology:
            if speaks_of(definition, DefinitionKey(section=Section.OBJECTS, name=rename.to), ontology):
                message = f"cannot be called {rename.to}: the {key_of(definition)} refers to another {rename.to}; take another name"
                yield Violation(subject=rename.name, rule="duplicate", message=message)
    yield from _unusable(DefinitionKey(section=Section.OBJECTS, name=rename.name), rename.to)


def _unusable(subject: DefinitionKey | Renaming, name: str) -> Iterator[Violation]:
    if not is_name(name):
        message = f"{name!r} is not a name that formulas can use; use letters, digits, _ and -, and begin with a letter"
        yield _wrong(subject, "name", message)


def _unknown(subject: DefinitionKey | Renaming, ontology: Ontology) -> str:
    hint = nearest(subject.name, getattr(ontology, subject.section)) or "it may have been removed or renamed: read the ontology again"
    return f"there is no {SINGULAR[subject.section]} {subject.name}; {hint}"

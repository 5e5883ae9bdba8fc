"""Two objects of the map that are one: an object that was added by a sighting turns out to be one that was known before.

`merged_object.py` says what the map has of it then.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from somrs.entish.parse import nearest
from somrs.ontology.conformance import Violation
from somrs.ontology.map import Map
from somrs.ontology.naming import DefinitionKey, Section, key_of
from somrs.ontology.renaming import speaks_of
from somrs.ontology.types import Ontology
from somrs.protocol.messages.knowledge import MergeObject, Merging
from somrs.repository.association import compatible_types
from somrs.repository.merged_object import merge_changes
from somrs.repository.outcome import Outcome
from somrs.repository.provenance import Provenance
from somrs.repository.update import changes_outcome


def merge_outcome(map: Map, ontology: Ontology, provenance: Provenance, merge: MergeObject) -> Outcome:
    """The outcome of a statement that two objects of the map are one."""
    if impossible := tuple(_impossible(map, ontology, provenance, merge)):
        return Outcome(map=map, ontology=ontology, broken=impossible)
    merging = Merging(name=merge.name, into=merge.into)
    return replace(changes_outcome(map, ontology, merge_changes(merging, map, ontology, provenance)), merged=(merging,))


def _impossible(map: Map, ontology: Ontology, provenance: Provenance, merge: MergeObject) -> Iterator[Violation]:
    name, into = merge.name, merge.into
    if name == into:
        yield _wrong(name, "duplicate", "is itself; name another object that it is")
        return
    if provenance.current_name(name) == into and name not in map.objects:
        yield _wrong(name, "duplicate", f"is known to be {into} already")
        return
    for missing in (object_name for object_name in (name, into) if object_name not in map.objects):
        hint = nearest(missing, map.similar_names(missing)) or "add it first"
        yield _wrong(missing, "unknown-object", f"there is no object {missing} on the map; {hint}")
    if name not in map.objects or into not in map.objects:
        return
    types = {object_name: map.objects[object_name].type for object_name in (name, into)}
    for object_name, type_name in types.items():
        if ontology.is_device(type_name):
            yield _wrong(object_name, "device", "is a device, which joins under its own name, and is no other object")
    if types[into] not in compatible_types(types[name], ontology):
        message = f"is a {types[name]}, and {into} is a {types[into]}; they can be one object if one type is a super-type of the other"
        yield _wrong(name, "type", message)
    for fact in map.facts_about(name):
        if into in fact.arguments:
            yield _wrong(name, "related", f"and {into} are two objects as long as {fact}; remove that fact first")
    for definition in ontology:
        # Unlike a new name, another object may make the definition wrong.
        if speaks_of(definition, DefinitionKey(section=Section.OBJECTS, name=name), ontology):
            yield _wrong(name, "referred-to", f"is named in the {key_of(definition)}; name {into} there first")


def _wrong(name: str, rule: str, message: str) -> Violation:
    return Violation(subject=name, rule=rule, message=message)

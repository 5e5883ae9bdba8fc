"""The objects of a map that a change of its ontology may affect. Only their conformance is checked again."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from msgspec import structs

from somrs.ontology.complex_values import inner_paths
from somrs.ontology.conformance import Violation, violations, violations_of
from somrs.ontology.map import Map
from somrs.ontology.naming import DefinitionKey, Section, find_definition
from somrs.ontology.types import ABSTRACT, ObjectType, Ontology

_WORD = re.compile(r"\w+(?:-\w+)*")


def violations_after(map: Map, ontology_before: Ontology, ontology_after: Ontology, changed: Iterable[DefinitionKey]) -> list[Violation]:
    """The violations of a map after a change of the ontology. The map conformed to `ontology_before`; the `changed` definitions are now
    those of `ontology_after`."""
    names: dict[Section, set[str]] = {section: set() for section in Section}
    for definition_key in changed:
        if not _only_doc_differs(ontology_before, ontology_after, definition_key):
            names[definition_key.section].add(definition_key.name)
    types = _types(ontology_before, ontology_after, names)
    if any(_was_abstract(name, ontology_before, ontology_after) and map.of_type(name) for name in types):
        return violations(map, ontology_after)  # such an object may be the root, which is part of no object
    objects = {object for name in types for object in map.of_type(name)}
    objects.update(name for relation in names[Section.RELATIONS] for fact in map.facts(relation) for name in fact.arguments)
    return violations_of(map, ontology_after, objects) if objects else []


def _only_doc_differs(ontology_before: Ontology, ontology_after: Ontology, definition_key: DefinitionKey) -> bool:
    """Whether only the documentation differs."""
    old, new = find_definition(ontology_before, definition_key), find_definition(ontology_after, definition_key)
    return old is not None and new is not None and structs.replace(old, doc="") == structs.replace(new, doc="")


def _was_abstract(name: str, ontology_before: Ontology, ontology_after: Ontology) -> bool:
    """Whether the type changed between abstract and physical, or was removed."""
    return ontology_before.is_subtype(name, ABSTRACT) != ontology_after.is_subtype(name, ABSTRACT)


def _types(ontology_before: Ontology, ontology_after: Ontology, changed: dict[Section, set[str]]) -> set[str]:
    """The types whose objects have other rules than before."""
    attributes = changed[Section.ATTRIBUTES]
    words = attributes | changed[Section.RELATIONS] | changed[Section.FUNCTIONS]
    moved = any(_parent(ontology_before, name) != _parent(ontology_after, name) for name in changed[Section.TYPES])
    affected_types = set(changed[Section.TYPES])
    for ontology in (ontology_before, ontology_after):
        for type in ontology.types.values():
            paths = ontology.attributes_of(type.name) if attributes else ()
            changed_path = any(not attributes.isdisjoint(path.split(".")) for path in paths)
            if changed_path or _speaks_of(type, words, moved) or _conforms_to(type, attributes, ontology):
                affected_types.add(type.name)
    return {name for ontology in (ontology_before, ontology_after) for name in _with_subtypes(ontology, affected_types)}


def _speaks_of(type: ObjectType, words: set[str], moved: bool) -> bool:
    """Whether a formula of the type uses one of the names, or, if types have `moved` in the hierarchy, a typed variable."""
    formulas: Iterator[str] = (constraint.formula for constraint in type.constraints if constraint.formula is not None)
    return any((moved and ":" in formula) or not words.isdisjoint(_WORD.findall(formula)) for formula in formulas)


def _conforms_to(type: ObjectType, attributes: set[str], ontology: Ontology) -> bool:
    """Whether the objects of the type have to conform to one of the complex attributes, or to one that contains one of them."""
    names = {value for constraint in type.constraints for value in constraint.values if isinstance(value, str)} if attributes else set()
    return any(
        name in attributes
        or any(not attributes.isdisjoint(path.split(".")) for path, _ in inner_paths(ontology.attributes[name], ontology))
        for name in names
        if name in ontology.attributes
    )


def _parent(ontology: Ontology, name: str) -> str | None:
    type = ontology.types.get(name)
    return type.parent if type is not None else None


def _with_subtypes(ontology: Ontology, types: set[str]) -> Iterator[str]:
    yield from types
    yield from (name for name in ontology.types if not types.isdisjoint(ontology.ancestors(name)))

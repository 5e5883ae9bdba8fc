"""Which objects of a map a change of its ontology concerns: whether they still conform has to be looked at, and of no others."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from msgspec import structs

from somrs.ontology.conformance import Violation, violations, violations_of
from somrs.ontology.naming import Named, Section, find
from somrs.ontology.objects import Map
from somrs.ontology.types import ABSTRACT, ObjectType, Ontology

_WORD = re.compile(r"\w+(?:-\w+)*")


def violations_after(map: Map, before: Ontology, after: Ontology, changed: Iterable[Named]) -> list[Violation]:
    """What is wrong with a map that obeyed the ontology `before`, now that the `changed` definitions of it are as in `after`."""
    names: dict[Section, set[str]] = {section: set() for section in Section}
    for what in changed:
        if not _same(before, after, what):
            names[what.section].add(what.name)
    types = _types(before, after, names)
    if any(_was_abstract(name, before, after) and map.of_type(name) for name in types):
        return violations(map, after)  # it may be the root, which is nobody's part
    objects = {object for name in types for object in map.of_type(name)}
    objects.update(name for relation in names[Section.RELATIONS] for fact in map.facts(relation) for name in fact.arguments)
    return violations_of(map, after, objects) if objects else []


def _same(before: Ontology, after: Ontology, what: Named) -> bool:
    """Whether nothing is different but what people read."""
    old, new = find(before, what), find(after, what)
    return old is not None and new is not None and structs.replace(old, doc="") == structs.replace(new, doc="")


def _was_abstract(name: str, before: Ontology, after: Ontology) -> bool:
    """Whether objects of the type became physical ones, or the other way round, or have lost their type."""
    return before.is_a(name, ABSTRACT) != after.is_a(name, ABSTRACT)


def _types(before: Ontology, after: Ontology, changed: dict[Section, set[str]]) -> set[str]:
    """The types of which objects have other rules than they had."""
    attributes = changed[Section.ATTRIBUTES]
    words = attributes | changed[Section.RELATIONS] | changed[Section.FUNCTIONS]
    moved = any(_parent(before, name) != _parent(after, name) for name in changed[Section.TYPES])
    found = set(changed[Section.TYPES])
    for ontology in (before, after):
        for type in ontology.types.values():
            paths = ontology.attributes_of(type.name) if attributes else ()
            if any(not attributes.isdisjoint(path.split(".")) for path in paths) or _speaks_of(type, words, moved):
                found.add(type.name)
    return {name for ontology in (before, after) for name in _below(ontology, found)}


def _speaks_of(type: ObjectType, words: set[str], moved: bool) -> bool:
    """Whether a formula of the type has one of the words in it, or, if types `moved`, a variable of some type."""
    formulas: Iterator[str] = (constraint.formula for constraint in type.constraints if constraint.formula is not None)
    return any((moved and ":" in formula) or not words.isdisjoint(_WORD.findall(formula)) for formula in formulas)


def _parent(ontology: Ontology, name: str) -> str | None:
    type = ontology.types.get(name)
    return type.parent if type is not None else None


def _below(ontology: Ontology, types: set[str]) -> Iterator[str]:
    yield from types
    yield from (name for name in ontology.types if not types.isdisjoint(ontology.ancestors(name)))

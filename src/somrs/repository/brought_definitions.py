"""Computes the outcome when a device brings definitions with its program.

A definition that the ontology has is left as it is, so that a change by an editor outlasts the restart of a device. The device may revise
its own definitions. A program that does not agree with the definition of another author is refused, because the name has one meaning.
The service types of the shipped devices give way: they are nobody's until somebody defines them.
"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import structs

from somrs.ontology.agreement import disagreements
from somrs.ontology.conformance import Violation
from somrs.ontology.files.levels import LIBRARY
from somrs.ontology.naming import find_definition, key_of, section_of
from somrs.ontology.types import Definition
from somrs.protocol.messages.knowledge import Define, by_kind
from somrs.protocol.messages.people import person_name
from somrs.repository.definition import define_outcome
from somrs.repository.outcome import Outcome
from somrs.repository.state import Contents


def brought_outcome(contents: Contents, define: Define) -> Outcome:
    """The outcome: the new definitions and the author's own revised ones are defined."""
    definitions = [*define.definitions.all_definitions()]
    refused = tuple(violation for definition in definitions for violation in _disagreement(contents, define.author, definition))
    if refused:
        return Outcome(map=contents.map, ontology=contents.ontology, broken=refused)
    added = (definition for definition in definitions if _may_define(contents, define.author, definition))
    return define_outcome(contents.map, contents.ontology, structs.replace(define, definitions=by_kind(added)))


def _may_define(contents: Contents, author: str, definition: Definition) -> bool:
    key = key_of(definition)
    latest = contents.last_change(key)
    if latest is None:
        return key in LIBRARY or find_definition(contents.ontology, key) is None
    return find_definition(contents.ontology, key) is None or latest.author == author


def _disagreement(contents: Contents, author: str, definition: Definition) -> Iterator[Violation]:
    key = key_of(definition)
    existing = find_definition(contents.ontology, key)
    if existing is None or _may_define(contents, author, definition) or not (reasons := disagreements(definition, existing, provides=True)):
        return
    latest = contents.last_change(key)
    source = f"{person_name(latest.author)} in version {latest.version}" if latest is not None else "the ontology of the building"
    message = (
        f"is defined otherwise already, by {source}: {'; '.join(reasons)}. Use the definition that is there, "
        "change it there for all devices (the Ontology page, or somrs ontology import), or give yours another name"
    )
    yield Violation(subject=definition.name, rule="disagreement", message=message, section=section_of(definition))

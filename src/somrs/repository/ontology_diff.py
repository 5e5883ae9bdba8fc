"""The change of the ontology that turns one ontology into another."""

from __future__ import annotations

from somrs.ontology.naming import key_of
from somrs.ontology.types import Ontology
from somrs.protocol.messages.knowledge import Define, Revision
from somrs.repository.outcome import revision


def diff_ontologies(current_ontology: Ontology, target_ontology: Ontology, author: str = "", expected_version: int | None = None) -> Define:
    """The Define request that turns `current_ontology` into `target_ontology`."""
    change = revision(current_ontology, target_ontology) or Revision()
    target_keys = set(map(key_of, change.after.all_definitions()))
    removed = tuple(definition_key for definition_key in map(key_of, change.before.all_definitions()) if definition_key not in target_keys)
    return Define(definitions=change.after, removed=removed, author=author, expected_version=expected_version)

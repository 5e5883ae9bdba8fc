"""From one ontology to another: the change that leads there."""

from __future__ import annotations

from somrs.ontology.naming import key_of
from somrs.ontology.types import Ontology
from somrs.protocol.messages.knowledge import Define, Revision
from somrs.repository.outcome import revision


def diff_ontologies(current_ontology: Ontology, target_ontology: Ontology, author: str = "", expected_version: int | None = None) -> Define:
    """What has to be removed and defined so that the known ontology becomes the wanted one."""
    change = revision(current_ontology, target_ontology) or Revision()
    target_keys = set(map(key_of, change.after.all_definitions()))
    removed = tuple(definition_key for definition_key in map(key_of, change.before.all_definitions()) if definition_key not in target_keys)
    return Define(definitions=change.after, removed=removed, author=author, expected_version=expected_version)

"""From one ontology to another: the change that leads there."""

from __future__ import annotations

from somrs.ontology.naming import key_of
from somrs.ontology.types import Ontology
from somrs.protocol.messages.knowledge import Define, Revision
from somrs.repository.outcome import revision


def leading_to(known: Ontology, wanted: Ontology, author: str = "", expected_version: int | None = None) -> Define:
    """What has to be removed and defined so that the known ontology becomes the wanted one."""
    change = revision(known, wanted) or Revision()
    there = set(map(key_of, change.after.all_definitions()))
    removed = tuple(what for what in map(key_of, change.before.all_definitions()) if what not in there)
    return Define(definitions=change.after, removed=removed, author=author, expected_version=expected_version)

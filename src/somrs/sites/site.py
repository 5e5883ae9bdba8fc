"""What an importer brings in."""

from __future__ import annotations

from dataclasses import dataclass

from somrs.ontology.objects import Map
from somrs.ontology.types import Ontology


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """A building as brought in: the upper ontology with what the site adds, its map, and notes for people about what could
    not be brought in as it was."""

    name: str
    ontology: Ontology
    map: Map
    notes: tuple[str, ...] = ()

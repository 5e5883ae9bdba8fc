"""The result of an import."""

from __future__ import annotations

from dataclasses import dataclass

from somrs.ontology.objects import Map
from somrs.ontology.types import Ontology


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """An imported building: the upper ontology with the site's own definitions, the map, and notes for people about what was changed
    or left out."""

    name: str
    ontology: Ontology
    map: Map
    notes: tuple[str, ...] = ()

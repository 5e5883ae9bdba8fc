"""The result of an import, and what importers have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.sites.models import ModelTable, shipped_models
from somrs.sites.notes import Note


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """An imported building: the upper ontology with the site's own definitions, the map, and notes for people about what was changed
    or left out."""

    name: str
    ontology: Ontology
    map: Map
    notes: tuple[Note, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """How to import a building."""

    models: ModelTable = field(default_factory=shipped_models)
    crowds: bool = False
    """Whether to import the people of simulated crowds, and their lanes."""


Importer = Callable[[Path, ImportOptions], Site]

"""The content of ontology and map files, and where in the files it was read. `loading.py` reads it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Any

from somrs.ontology.files.nodes import Path, Source
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology

POSITION = ("PositionX", "PositionY", "PositionZ")
"""The attributes that objects may have as `at`, in one list."""


@dataclass(slots=True)
class Place:
    """The place in a file where an object, a fact or a definition was read."""

    source: Source
    path: Path

    def line(self, inner: str = "") -> int | None:
        """The line of the key at the path `inner`, or at the longest part of it that is written."""
        keys = self.source.keys(self.path)
        if inner in keys:
            return self.source.line((*self.path, inner))
        steps = tuple(int(step) if step.isdigit() else step for step in inner.split(".")) if inner else ()
        short = {"RotationZ": "turned", **dict.fromkeys(POSITION, "at")}.get(inner)
        return self.source.line((*self.path, *((short,) if short in keys and short is not None else steps)))


@dataclass(frozen=True, slots=True)
class AdapterEntry:
    """What a file has of an adapter: its name, its settings, and the folder of the file."""

    name: str
    settings: Mapping[str, Any]
    folder: FilePath
    source: Source = field(repr=False, compare=False)

    def written(self, path: Path) -> tuple[str, int | None]:
        """The file and the line where a setting is."""
        return self.source.file, self.source.line(("adapters", self.name, *path))


@dataclass(frozen=True, slots=True)
class LoadedModel:
    """The content of files: the ontology, including its base, the map, if there is one, and the adapters by name.

    `places`: by section and name: `objects Jar002`, `types Jar`, `facts Jar002 isOn Cupboard001`.
    """

    ontology: Ontology
    map: Map | None
    places: Mapping[str, Place] = field(default_factory=dict, repr=False, compare=False)
    adapters: Mapping[str, AdapterEntry] = field(default_factory=dict, compare=False)

    def written(self, object: str) -> tuple[str, int | None]:
        """The file and the line where an object is defined."""
        place = self.places.get(f"objects {object}")
        return (place.source.file, place.line()) if place is not None else ("map", None)

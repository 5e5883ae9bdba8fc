"""Reads mapping files: definitions as in a site's files, and besides `connections:` and `things:`."""

from __future__ import annotations

import copy
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from msgspec import Struct

from somrs.adapters.things.connections import parse_connection
from somrs.adapters.things.library import ontology_below
from somrs.adapters.things.mapping import SECTIONS, KeyPath, MappingFile
from somrs.adapters.things.mapping_checks import common_problems
from somrs.adapters.things.model import Connection, Thing
from somrs.adapters.things.resolving import Resolver
from somrs.errors import InputError, ModelError, Problem
from somrs.ontology.files.loading import NAME, load
from somrs.ontology.files.nodes import Source
from somrs.ontology.files.structure import model_problems
from somrs.ontology.types import Ontology


class LoadedMapping(Struct, frozen=True, kw_only=True):
    """What a mapping file has. `ontology`: what things are defined by, with the upper ontology and the shipped types of things."""

    connections: Mapping[str, Connection]
    things: tuple[Thing, ...]
    ontology: Ontology


def read_mapping(path: Path, connections: Mapping[str, Connection] | None = None, used_files: Sequence[Path] = ()) -> LoadedMapping:
    """Read a mapping file and the files that it uses. `connections`: those of the settings; `used_files`: further files with definitions.

    Raises ModelError with all problems.
    """
    paths = [*used_files, path]
    _check_has_no_map(path)
    ontology = load(paths, ontology_below(paths), SECTIONS).ontology
    source = Source(str(path), path.read_text("utf-8-sig"))
    return _Reading(source, ontology, dict(connections or {})).finish()


def _check_has_no_map(path: Path) -> None:
    """Raises ModelError if a mapping file has objects, as the files of a site have."""
    try:
        source = Source(str(path), path.read_text("utf-8-sig"))
    except (OSError, UnicodeDecodeError):
        return  # which `load` says
    keys = [key for key in ("map", "objects", "facts") if isinstance(source.data, dict) and key in source.data]
    text = "belongs into a file of the site: a mapping file has connections, things and definitions"
    if keys:
        raise ModelError([Problem(file=source.file, line=source.line((key,)), subject=key, rule="mapping", message=text) for key in keys])


def _leave_out(data: dict[str, Any], path: KeyPath) -> KeyPath:
    """Take what is at the path out of a document, or the innermost entry around it that is there. Returns the path of what lacks it."""
    for length in range(len(path), 0, -1):
        container: Any = data
        for step in path[: length - 1]:
            container = container[step] if _has(container, step) else None
        if _has(container, path[length - 1]):
            del container[path[length - 1]]
            return path[: length - 1]
    data.clear()
    return ()


def _has(container: object, step: str | int) -> bool:
    if isinstance(container, dict):
        return step in container
    return isinstance(container, list) and isinstance(step, int) and step < len(container)


class _Reading:
    def __init__(self, source: Source, ontology: Ontology, connections: dict[str, Connection]) -> None:
        self.source, self.ontology, self.connections = source, ontology, connections
        self.problems: list[Problem] = []

    def finish(self) -> LoadedMapping:
        file, broken = self._structure()
        for name, entry in file.connections.items():
            try:
                self.connections[name] = parse_connection(name, entry, Path(self.source.file).parent)
            except InputError as error:
                self._problem(("connections", name), str(error))
        if len(self.connections) < len(file.connections) or any(path[:1] == ("connections",) for path in broken):
            raise ModelError(self.problems)  # what follows of the things would only confuse
        own_connections = [name for name in file.connections if name in self.connections]
        things = tuple(self._things(file, own_connections[0] if len(own_connections) == 1 else None, broken))
        for name, message in common_problems(things):
            self._problem(("things", name, "session"), message)
        if self.problems:
            raise ModelError(sorted(self.problems, key=lambda problem: problem.line or 0))
        return LoadedMapping(connections=self.connections, things=things, ontology=self.ontology)

    def _structure(self) -> tuple[MappingFile, set[KeyPath]]:
        """The file without what does not fit its structure, and the entries that lack something therefore."""
        data = copy.deepcopy({key: self.source.data.get(key, {}) for key in SECTIONS if key in self.source.data})
        broken: set[KeyPath] = set()
        is_first = True
        while problems := [*model_problems(data, MappingFile)]:
            for path, _, message in problems:
                if is_first:
                    self._problem(path, message)
                broken.add(_leave_out(data, path if is_first else path[:2]))
            is_first = False
        return MappingFile.model_validate(data), broken

    def _things(self, file: MappingFile, default_connection: str | None, broken: Collection[KeyPath]) -> Iterator[Thing]:
        for name, entry in file.things.items():
            if NAME.fullmatch(name) is None:
                self._problem(("things", name), "is not a name of an object: a letter, and then letters, digits, _ or -")
                continue
            resolver = Resolver(name, self.ontology, self.connections, default_connection)
            thing = resolver.thing(entry)
            for path, message in resolver.problems:
                if ("things", name, *path) not in broken:  # what follows from what was left out would only confuse
                    self._problem(("things", name, *path), message)
            if thing is not None:
                yield thing

    def _problem(self, path: tuple[str | int, ...], message: str) -> None:
        subject = str(path[1]) if len(path) > 1 else str(path[0]) if path else "file"
        problem = Problem(file=self.source.file, line=self.source.line(path), subject=subject, rule="mapping", message=message)
        if problem not in self.problems:
            self.problems.append(problem)

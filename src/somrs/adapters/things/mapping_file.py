"""Reads mapping files: definitions as in a site's files, and besides `connections:` and `things:`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from msgspec import Struct

from somrs.adapters.things.connections import parse_connection
from somrs.adapters.things.library import ontology_below
from somrs.adapters.things.mapping import SECTIONS, MappingFile
from somrs.adapters.things.mapping_checks import common_problems
from somrs.adapters.things.model import Connection, Thing
from somrs.adapters.things.resolving import Resolver
from somrs.errors import InputError, ModelError, Problem
from somrs.ontology.files.documents import Document, follows, read_document
from somrs.ontology.files.loading import NAME, load
from somrs.ontology.files.nodes import Source
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


class _Reading:
    def __init__(self, source: Source, ontology: Ontology, connections: dict[str, Connection]) -> None:
        self.source, self.ontology, self.connections = source, ontology, connections
        self.problems: list[Problem] = []

    def finish(self) -> LoadedMapping:
        file, document = self._structure()
        for name, entry in file.connections.items():
            try:
                self.connections[name] = parse_connection(name, entry, Path(self.source.file).parent)
            except InputError as error:
                self._problem(("connections", name), str(error))
        if file.connections.keys() - self.connections.keys() or any(path[:1] == ("connections",) for path in document.incomplete):
            raise ModelError(self.problems)  # what follows of the things would only confuse
        own_connections = [name for name in file.connections if name in self.connections]
        things = tuple(self._things(file, own_connections[0] if len(own_connections) == 1 else None, document))
        for name, message in common_problems(things):
            self._problem(("things", name, "session"), message)
        if self.problems:
            raise ModelError(sorted(self.problems, key=lambda problem: problem.line or 0))
        return LoadedMapping(connections=self.connections, things=things, ontology=self.ontology)

    def _structure(self) -> tuple[MappingFile, Document[MappingFile]]:
        """The file without what does not fit its structure, and what that is."""
        document = read_document({key: self.source.data.get(key, {}) for key in SECTIONS if key in self.source.data}, MappingFile)
        for path, _, message in document.misfits:
            self._problem(path, message)
        assert document.content is not None, "nothing is required"
        return document.content, document

    def _things(self, file: MappingFile, default_connection: str | None, document: Document[MappingFile]) -> Iterator[Thing]:
        for name, entry in file.things.items():
            if NAME.fullmatch(name) is None:
                self._problem(("things", name), "is not a name of an object: a letter, and then letters, digits, _ or -")
                continue
            resolver = Resolver(name, self.ontology, self.connections, default_connection)
            thing = resolver.thing(entry)
            for path, message in resolver.problems:
                if not follows(("things", name, *path), document):  # what follows from what was left out would only confuse
                    self._problem(("things", name, *path), message)
            if thing is not None:
                yield thing

    def _problem(self, path: tuple[str | int, ...], message: str) -> None:
        subject = str(path[1]) if len(path) > 1 else str(path[0]) if path else "file"
        problem = Problem(file=self.source.file, line=self.source.line(path), subject=subject, rule="mapping", message=message)
        if problem not in self.problems:
            self.problems.append(problem)

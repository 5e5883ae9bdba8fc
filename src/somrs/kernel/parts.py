"""The large parts of a state, which a snapshot stores entry by entry beside its document. The next one writes only what has changed.

Only maps have such parts: their objects, and the facts of a relation, as far as they are in pages (`ontology/paged.py`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import msgspec
from msgspec import Struct

from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.paged import PagedDict, changed_keys

T = TypeVar("T")

OBJECTS = ""
"""Stands for the relation of the part with the objects of a map."""

CHUNK = 10_000
"""Entries that are decoded together, which is several times as fast as one by one."""

Parts = Mapping[str, Mapping[Any, Any]]
"""Parts by name: the objects of a map by their names, or the arguments of facts, each with None."""

_NOTHING: Mapping[Any, Any] = {}
_encode = msgspec.msgpack.Encoder().encode
_OBJECTS = msgspec.msgpack.Decoder(list[Object])
_TUPLES = msgspec.msgpack.Decoder(list[tuple[str, ...]])


class PartReference(Struct, frozen=True, array_like=True):
    """The facts of a relation of a map, or its objects: the name of their part, if they are in one, and the number of entries."""

    relation: str
    part: str = ""
    count: int = 0


class MapDocument(Struct, frozen=True, array_like=True):
    """The stored form of a map. `references`: if it has large parts, what is in which part, in the order of the map."""

    objects: list[Object]
    facts: list[Fact]
    references: list[PartReference] = []
    name: str = ""
    complete: list[str] = []


class PartsWriter:
    """Puts the large parts of the maps of a state aside. `parts` has them by name."""

    def __init__(self) -> None:
        self.parts: dict[str, Mapping[Any, Any]] = {}
        self._maps: list[Map] = []

    def document(self, map: Map) -> MapDocument:
        """The stored form of a map. A map that a state has twice is stored once."""
        number = next((number for number, earlier_map in enumerate(self._maps) if earlier_map is map), len(self._maps))
        if number == len(self._maps):
            self._maps.append(map)
        large = {relation: entries for relation, entries in ((OBJECTS, map.objects), *map.tuples()) if isinstance(entries, PagedDict)}
        names = {relation: f"{number} {relation}" for relation in large}
        self.parts.update((names[relation], entries) for relation, entries in large.items())
        return MapDocument(
            objects=[*map.objects.values()] if OBJECTS not in large else [],
            facts=[Fact(relation, arguments) for relation, tuples in map.tuples() if relation not in large for arguments in tuples],
            references=[
                PartReference(relation, names.get(relation, ""), len(large.get(relation, ())))
                for relation in (OBJECTS, *(relation for relation, _ in map.tuples()))
            ]
            if large
            else [],
            name=map.name,
            complete=sorted(map.complete),
        )


@dataclass(slots=True)
class PartChanges:
    """What a snapshot changes in the stored parts: entries to write, as part, key and value, and entries to remove, as part and key."""

    written: list[tuple[str, bytes, bytes]] = field(default_factory=list)
    removed: list[tuple[str, bytes]] = field(default_factory=list)


def part_changes(stored: Parts, parts: Parts) -> PartChanges:
    """The changes of the stored parts that lead to others. They take no time for pages that both share."""
    changes = PartChanges()
    for part in dict.fromkeys((*stored, *parts)):
        entries = parts.get(part, _NOTHING)
        for key in changed_keys(stored.get(part, _NOTHING), entries):
            if key in entries:
                changes.written.append((part, _encode(key), _encode(entries[key]) if entries[key] is not None else b""))
            else:
                changes.removed.append((part, _encode(key)))
    return changes


class PartsReader:
    """The stored parts: of each, documents of some entries. `parts` has those that were read, by name."""

    def __init__(self, documents: Mapping[str, Sequence[bytes]]) -> None:
        self._documents = documents
        self.parts: dict[str, Mapping[Any, Any]] = {}

    def map(self, document: MapDocument) -> Map:
        """The map. Raises ValueError if entries are missing."""
        map = Map(self._objects(document), self._facts(document), document.name, document.complete)
        tuples = dict(map.tuples())
        for reference in document.references:
            if reference.part:
                entries = map.objects if reference.relation == OBJECTS else tuples.get(reference.relation, _NOTHING)
                if len(entries) != reference.count:
                    subject = f"the facts of {reference.relation}" if reference.relation else "the objects"
                    raise ValueError(f"{subject} of the map are {len(entries)}, and not {reference.count}")
                self.parts[reference.part] = entries
        return map

    def _objects(self, document: MapDocument) -> Iterator[Object]:
        yield from document.objects
        for reference in document.references:
            if reference.relation == OBJECTS:
                yield from self._entries(reference, _OBJECTS)

    def _facts(self, document: MapDocument) -> Iterator[Fact]:
        references = document.references or [
            PartReference(relation) for relation in dict.fromkeys(fact.relation for fact in document.facts)
        ]
        for reference in references:
            yield from (fact for fact in document.facts if fact.relation == reference.relation)
            if reference.relation != OBJECTS:
                yield from (Fact(reference.relation, arguments) for arguments in self._entries(reference, _TUPLES))

    def _entries(self, reference: PartReference, decoder: msgspec.msgpack.Decoder[list[T]]) -> Iterator[T]:
        return (entry for document in self._documents.get(reference.part, ()) for entry in decoder.decode(document))


def chunk_document(entries: Sequence[bytes]) -> bytes:
    """A document of entries as `PartsReader` reads it: of an object its value, of a fact its key."""
    return b"\xdd" + len(entries).to_bytes(4, "big") + b"".join(entries)

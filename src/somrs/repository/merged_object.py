"""The changes that make one object of the map of two.

The object keeps one of the two names, and has what is known under both. Of where it is, and of attributes that change, the newer news
counts. Of attributes that it is recognised by, the value of the name that stays counts.
"""

from __future__ import annotations

from collections.abc import Iterator

from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved
from somrs.ontology.types import UNKNOWN, Kind, Ontology
from somrs.ontology.values import attribute_at
from somrs.protocol.messages.knowledge import Merging
from somrs.repository.association import changing_attributes, exclusive_relations
from somrs.repository.provenance import Provenance, fact_aspect, location_aspect

_POSE = ("Position", "Rotation")
"""Beginnings of the attributes of the pose."""


def merge_changes(merging: Merging, map: Map, ontology: Ontology, provenance: Provenance) -> list[Change]:
    """The changes that make one object of two, without regard to whether they may be one."""
    return [*_Merge(merging, map, ontology, provenance).changes()]


class _Merge:
    def __init__(self, merging: Merging, map: Map, ontology: Ontology, provenance: Provenance) -> None:
        self.name, self.into = merging.name, merging.into
        self.map, self.ontology, self.provenance = map, ontology, provenance
        self.places = {*exclusive_relations(ontology)}
        self.is_elsewhere = self._place_news(self.name) > self._place_news(self.into)
        """Whether the object is where the map has it under the name that it loses."""

    def changes(self) -> Iterator[Change]:
        facts = [*self.map.facts_about(self.name)]
        yield from (FactRemoved(fact) for fact in facts)
        yield ObjectRemoved(self.name)
        yield ObjectAdded(self._object())
        if self.is_elsewhere:
            yield from (FactRemoved(fact) for fact in self._facts_of(self.into) if fact.relation in self.places)
        for fact in facts:
            renamed = Fact(fact.relation, tuple(self.into if argument == self.name else argument for argument in fact.arguments))
            if renamed.arguments.count(self.into) == 1 and self._holds(fact, renamed):
                yield from self._replaced(renamed)
                yield FactAdded(renamed)

    def _object(self) -> Object:
        known, other = self.map.objects[self.into], self.map.objects[self.name]
        type_name = other.type if self.ontology.is_subtype(other.type, known.type) else known.type
        pose = {path: value for path, value in (other if self.is_elsewhere else known).values.items() if self._is_of_place(path)}
        values = {path: value for path, value in known.values.items() if not self._is_of_place(path)}
        changing = changing_attributes(self.ontology)
        for path, value in other.values.items():
            if not self._is_of_place(path) and (path not in values or (self._changes(path, changing) and self._is_newer(path))):
                values[path] = value
        return Object(name=self.into, type=type_name, values={**values, **pose})

    def _holds(self, fact: Fact, renamed: Fact) -> bool:
        """Whether the object has the fact under the name that it keeps."""
        if fact.arguments[0] != self.name:
            return True
        if fact.relation in self.places:
            return self.is_elsewhere
        location = location_aspect(fact, self.ontology)
        if location is not None:  # a functional relation, such as `isPartOf`
            return self._is_newer(location[1]) or not self.map.facts_with(fact.relation, 0, self.into)
        return self.provenance.time(fact_aspect(renamed, self.ontology)) <= self.provenance.time(fact_aspect(fact, self.ontology))

    def _replaced(self, fact: Fact) -> Iterator[Change]:
        """The fact that another one of a functional relation replaces."""
        relation = self.ontology.relations[fact.relation]
        if relation.functional and fact.relation not in self.places:
            rivals = self.map.facts_with(fact.relation, 0, fact.arguments[0])
            yield from (FactRemoved(Fact(fact.relation, arguments)) for arguments in rivals if arguments != fact.arguments)

    def _facts_of(self, name: str) -> Iterator[Fact]:
        return (fact for fact in self.map.facts_about(name) if fact.arguments[0] == name)

    def _place_news(self, name: str) -> tuple[float, bool]:
        """When the latest news held of where the object is, and whether a place is known. That it was missed somewhere is no such news."""
        groups = {f"<{relation.excludes}>" for relation in self.ontology.relations.values() if relation.name in self.places}
        times = self.provenance.times.get(name, {}).items()
        latest = max((time for aspect, time in times if aspect in groups or aspect.startswith(_POSE)), default=0.0)
        return latest, any(fact.relation in self.places for fact in self._facts_of(name))

    def _is_of_place(self, path: str) -> bool:
        return path == UNKNOWN or path.startswith(_POSE)

    def _changes(self, path: str, changing: set[str]) -> bool:
        """Whether an object is not recognised by the attribute, because it changes."""
        attribute = attribute_at(path, self.ontology)
        return path in changing or attribute is None or attribute.kind is Kind.TRUTH

    def _is_newer(self, subject: str) -> bool:
        """Whether the news under the name that the object loses is newer."""
        return self.provenance.time((self.name, subject)) > self.provenance.time((self.into, subject))

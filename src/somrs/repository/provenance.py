"""Since when the map has each of its facts and values, so that older news does not replace newer.

News of an object is about aspects of it: an attribute, what it is on, in or held by (one aspect for all relations of an exclusive group),
or a single fact. Of two reports on an aspect, the one with the later `as_of` counts, whichever arrives first.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec import Struct, field, structs

from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import UNKNOWN, Ontology
from somrs.protocol.messages.observations import Discovery

REMEMBERED = 1000
"""The number of removed objects that are remembered, to recognise late reports about them."""

Aspect = tuple[str, str]
"""An object, and what the news about it is about."""


class Departure(Struct, frozen=True, kw_only=True):
    """An object that was removed from the map, as it was then. `at`: seconds since 1970."""

    object: Object
    at: float


class FormerName(Struct, frozen=True, kw_only=True):
    """A name that an object had, and has no longer: `name` is its name now.

    If it was an object of its own that turned out to be this one: `object`, as it was then, and its `discovery`.
    """

    name: str
    object: Object | None = None
    discovery: Discovery | None = None


class Provenance(Struct, kw_only=True):
    """`times`: for each object and aspect, when the latest news about it held, in seconds since 1970.

    `departures`: the removed objects, latest last. `discoveries`: the objects that sightings put on the map. `former_names`: the names that
    objects lost, latest last.
    """

    times: dict[str, dict[str, float]] = field(default_factory=dict)
    departures: dict[str, Departure] = field(default_factory=dict)
    discoveries: dict[str, Discovery] = field(default_factory=dict)
    former_names: dict[str, FormerName] = field(default_factory=dict)

    @property
    def provisional(self) -> list[str]:
        """The objects that are known from sightings only."""
        return [name for name, discovery in self.discoveries.items() if not discovery.confirmed]

    def current_name(self, name: str) -> str:
        """The name that an object with this name has now."""
        former_name = self.former_names.get(name)
        return former_name.name if former_name is not None else name

    def time(self, aspect: Aspect) -> float:
        """When the latest news about the aspect held; 0 if there was none."""
        name, subject = aspect
        return self.times.get(name, {}).get(subject, 0.0)

    def latest(self, name: str) -> float:
        """When the latest news about any aspect of the object held."""
        return max(self.times.get(name, {}).values(), default=0.0)

    def departed_since(self, name: str, at: float) -> bool:
        """Whether the object was removed from the map after that time."""
        departure = self.departures.get(name)
        return departure is not None and departure.at > at

    def note(self, aspects: Iterable[Aspect], at: float) -> None:
        """There was news about the aspects, which held at that time."""
        for name, subject in aspects:
            times = self.times.setdefault(name, {})
            times[subject] = max(at, times.get(subject, 0.0))

    def add(self, object: Object) -> None:
        """The object is on the map now."""
        self.departures.pop(object.name, None)
        former_name = self.former_names.pop(object.name, None)
        if former_name is not None and former_name.object == object and former_name.discovery is not None:
            self.discoveries[object.name] = former_name.discovery  # it is an object of its own after all

    def remove(self, object: Object, at: float) -> None:
        """The object is no longer on the map."""
        self.times.pop(object.name, None)
        self.discoveries.pop(object.name, None)
        self.departures[object.name] = Departure(object=object, at=at)
        while len(self.departures) > REMEMBERED:
            del self.departures[next(iter(self.departures))]

    def rename(self, name: str, to: str) -> None:
        """A person renamed the object."""
        if name in self.times:
            self.times[to] = {_renamed_subject(subject, name, to): time for subject, time in self.times.pop(name).items()}
        if (discovery := self.discoveries.pop(name, None)) is not None:
            self.discoveries[to] = structs.replace(discovery, confirmed=True)
        self._note_former_name(name, FormerName(name=to))

    def merge(self, object: Object, into: str) -> None:
        """The object turned out to be another one. `object`: as it was."""
        times = self.times.setdefault(into, {})
        for subject, time in self.times.pop(object.name, {}).items():
            renamed = _renamed_subject(subject, object.name, into)
            times[renamed] = max(time, times.get(renamed, 0.0))
        discovery = self.discoveries.pop(object.name, None)
        if discovery is None and into in self.discoveries:
            self.discoveries[into] = structs.replace(self.discoveries[into], confirmed=True)
        self._note_former_name(object.name, FormerName(name=into, object=object, discovery=discovery))

    def _note_former_name(self, name: str, former_name: FormerName) -> None:
        for earlier_name, earlier in self.former_names.items():
            if earlier.name == name:
                self.former_names[earlier_name] = structs.replace(earlier, name=former_name.name)
        self.former_names.pop(former_name.name, None)
        self.former_names[name] = former_name
        while len(self.former_names) > REMEMBERED:
            del self.former_names[next(iter(self.former_names))]


def _renamed_subject(subject: str, name: str, to: str) -> str:
    """What news are about; a fact begins with the name of its object."""
    return f"{to}{subject.removeprefix(name)}" if subject.startswith(f"{name} ") else subject


def aspects_of(change: Change, ontology: Ontology) -> Iterator[Aspect]:
    """What a change is news about."""
    match change:
        case ObjectAdded() | ObjectRemoved():
            pass
        case ValueSet(name, path):
            yield name, path
        case FactAdded(fact):
            yield location_aspect(fact, ontology) or fact_aspect(fact, ontology)
            yield fact.arguments[0], UNKNOWN
        case FactRemoved(fact):
            yield fact_aspect(fact, ontology)


def location_aspect(fact: Fact, ontology: Ontology) -> Aspect | None:
    """The aspect of which at most one fact holds at a time: an exclusive group, or a functional relation. None for other facts."""
    relation = ontology.relations[fact.relation]
    if relation.excludes is not None:
        return fact.arguments[0], f"<{relation.excludes}>"
    return (fact.arguments[0], f"<{relation.name}>") if relation.functional else None


def fact_aspect(fact: Fact, ontology: Ontology) -> Aspect:
    """The aspect that is the fact itself; that of a symmetric relation is the same in both orders."""
    arguments = tuple(sorted(fact.arguments)) if ontology.relations[fact.relation].symmetric else fact.arguments
    return arguments[0], str(Fact(fact.relation, arguments))

"""Reads a reported situation: which objects it speaks of, which of its parts are news, and which changes of the map they are.

A typed variable of the situation is a sighted object. `association.py` decides which object of the map it is; a sighting of none adds an
object, with its type and the next free number as its name. `provenance.py` decides what is news.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain

from msgspec import structs

from somrs.entish.formula import (
    Atom,
    Attribute,
    Comparison,
    Formula,
    Name,
    Not,
    Relation,
    conjunction,
    conjuncts,
    literals,
    names,
    substitute,
    variables,
)
from somrs.entish.parse import read
from somrs.ontology.check import check
from somrs.ontology.effects import changes as changes_by
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.truth import formula_holds
from somrs.ontology.types import PART_OF, PHYSICAL, UNKNOWN, Ontology, Value
from somrs.protocol.messages.knowledge import Merging
from somrs.protocol.messages.observations import Observation, Reception
from somrs.repository.association import DEVICE, Sighting, Surroundings, associate, coinciding, exclusive_relations
from somrs.repository.merged_object import merge_changes
from somrs.repository.provenance import Aspect, Provenance, fact_aspect, location_aspect

MOST_NUMBERED = 10_000
"""Where there are more names, a new object does not get the number after the highest, but any number after which one is free."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """The changes that a report makes, what it is news about, and what became of it.

    `recognized`: objects that are known again by it. `merged`: objects that it shows to be others.
    """

    changes: tuple[Change, ...]
    aspects: tuple[Aspect, ...]
    recognized: frozenset[str]
    reception: Reception
    merged: tuple[Merging, ...]


def read_report(
    situation: str | None,
    observation: Observation,
    map: Map,
    ontology: Ontology,
    provenance: Provenance,
    time_seen: float,
    reserved: Collection[str] = (),
) -> Reading:
    """Read a report about the map that held `at` a time. `reserved`: names that new objects do not get.

    Raises FormulaError for a situation that does not fit the ontology, or does not say what holds.
    """
    return _Report(observation, map, ontology, provenance, time_seen, reserved).read(situation)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Identities:
    """The names of the sighted objects, by variables; those that are new; provisional objects that turned out to be sought ones;
    variables of which it is not certain what they are."""

    names: Mapping[str, str] = field(default_factory=dict)
    new: Mapping[str, Object] = field(default_factory=dict)
    duplicates: Mapping[str, str] = field(default_factory=dict)
    unidentified: Collection[str] = ()


class _Report:
    def __init__(
        self, observation: Observation, map: Map, ontology: Ontology, provenance: Provenance, time_seen: float, reserved: Collection[str]
    ) -> None:
        self.observation, self.map, self.ontology, self.provenance, self.at = observation, map, ontology, provenance, time_seen
        self.reserved = reserved
        self.aspects: list[Aspect] = []
        self.superseded: list[str] = []
        self.mentioned: set[str] = set(observation.gone)
        self.asserted: set[str] = set()
        """Objects of which something is said that is news."""
        self.doubted: set[str] = set()
        """Objects of which the report says itself whether they are known."""

    def read(self, text: str | None) -> Reading:
        # A late report may speak of objects that are not on the map any more.
        map_then = self.map.changed(ObjectAdded(object) for object in self._departed() if object.name not in self.map.objects)
        situation = check(text, self.ontology, map_then) if text is not None else None
        identities = self._identify(situation, map_then) if situation is not None and variables(situation) else _Identities()
        merged = tuple(Merging(name=name, into=into) for name, into in identities.duplicates.items())
        changes: list[Change] = [ObjectAdded(object) for object in identities.new.values()]
        for merging in merged:
            changes += merge_changes(merging, self.map.changed(changes), self.ontology, self.provenance)
        if situation is not None:
            changes += self._situation_changes(situation, identities, self.map.changed(changes))
            same = tuple(self._coinciding(changes, self.map.changed(changes)))
            for merging in same:
                changes += merge_changes(merging, self.map.changed(changes), self.ontology, self.provenance)
            merged += same
        missing = [*self._missing()]
        for name in missing:
            changes += self._unknown_changes(name)
        changes += self._departures()
        reception = Reception(
            as_of=self.observation.as_of,
            names=dict(identities.names),
            added=tuple(object.name for object in identities.new.values()),
            missing=tuple(missing),
            superseded=tuple(self.superseded),
            unidentified=tuple(identities.unidentified),
        )
        recognized = frozenset(self.asserted - self.doubted)
        aspects = tuple(self.aspects)
        return Reading(changes=tuple(changes), aspects=aspects, recognized=recognized, reception=reception, merged=merged)

    # Sighted objects

    def _departed(self) -> list[Object]:
        """The objects that were removed after the time of the report."""
        return [departure.object for departure in self.provenance.departures.values() if departure.at > self.at]

    def _identify(self, situation: Formula, map_then: Map) -> _Identities:
        """Which objects the variables of the situation are. Devices come first, because they may hold other objects."""
        sightings = sightings_of(situation, map_then, self.ontology)
        devices = [sighting for sighting in sightings if self.ontology.is_subtype(sighting.object.type, DEVICE)]
        around = self._surroundings()
        holders = associate(devices, self.map, self.ontology, around)
        others = [
            Sighting(variable=s.variable, object=s.object, place=holders.names.get(s.place, s.place) if s.place else None)
            for s in sightings
            if s not in devices
        ]
        association = associate(others, self.map, self.ontology, around)
        new: dict[str, Object] = {}
        for sighting in others:
            if sighting.variable in association.new:
                name = self._free_name(sighting.object.type, {object.name for object in new.values()})
                new[sighting.variable] = Object(name=name, type=sighting.object.type)
        names = {**holders.names, **association.names, **{variable: object.name for variable, object in new.items()}}
        self.mentioned.update(names.values(), association.duplicates)
        return _Identities(
            names={name: names[name] for name in variables(situation) if name in names},
            new=new,
            duplicates=association.duplicates,
            unidentified=[name for name in variables(situation) if name not in names],
        )

    def _free_name(self, type_name: str, new_names: Collection[str]) -> str:
        names = self.map.objects, self.reserved, new_names
        if len(self.map.objects) + len(self.reserved) <= MOST_NUMBERED:
            return free_name(type_name, chain(*names))
        return next_free_name(type_name, lambda name: any(name in used_names for used_names in names))

    def _surroundings(self) -> Surroundings:
        map, provenance = self.map, self.provenance
        sought = [name for name in self.observation.sought if name in map.objects]
        holding = [
            name for name in exclusive_relations(self.ontology) if self.ontology.is_subtype(self.ontology.relations[name].joins[1], DEVICE)
        ]
        return Surroundings(
            anywhere={*sought, *map.with_value(UNKNOWN, True), *self._searched_things()},
            sought=sought,
            held={fact.arguments[0] for relation in holding for fact in map.facts(relation)},
            moved={name for name, times in provenance.times.items() if _is_placed_after(times, self.at)}
            if self.observation.as_of is not None
            else (),
            departed=self._departed(),
            provisional=provenance.provisional,
        )

    # The situation

    def _situation_changes(self, situation: Formula, identities: _Identities, map: Map) -> list[Change]:
        bindings = {variable: Name(name) for variable, name in identities.names.items()}
        named = [substitute(part, bindings) for part in conjuncts(situation)]
        self.mentioned.update(name for part in named for name in names(part))
        news = [news for part in named if not variables(part) for news in self._news(part, map)]
        return changes_by(conjunction(*news), map, self.ontology) if news else []

    def _news(self, part: Formula, map: Map) -> Iterator[Formula]:
        """The part, if the map has nothing newer; also what else follows from it."""
        if any(name not in map.objects and self.provenance.departed_since(name, self.at) for name in names(part)):
            self.superseded.append(str(part))
            return
        match part:
            case Comparison(Attribute(Name(name), path), "=") | Comparison(_, "=", Attribute(Name(name), path)):
                yield from self._if_newer(part, (name, path), about=name)
                if path == UNKNOWN:
                    self.doubted.add(name)
            case Relation(relation) if relation in self.ontology.relations:
                yield from self._relation_news(part, map)
            case Not(Relation(relation) as atom) if relation in self.ontology.relations:
                fact = _fact(atom)
                location = location_aspect(fact, self.ontology)
                if location is not None and not map.has_fact(fact.relation, fact.arguments):
                    location = None  # it cannot contradict where the object is now
                yield from self._if_newer(part, location or fact_aspect(fact, self.ontology), news=fact_aspect(fact, self.ontology))
            case _:
                yield part

    def _relation_news(self, part: Relation, map: Map) -> Iterator[Formula]:
        fact = _fact(part)
        location, own = location_aspect(fact, self.ontology), fact_aspect(fact, self.ontology)
        if location is None or self.provenance.time(location) > self.at or self.provenance.time(own) <= self.at:
            yield from self._if_newer(part, location or own, about=fact.arguments[0])
            return
        # It held then, instead of what held before, and does not hold any more.
        self.superseded.append(str(part))
        self._note(location, about=fact.arguments[0])
        for rival in location_facts(fact.arguments[0], map, self.ontology):
            if location_aspect(rival, self.ontology) == location:
                yield Not(Relation(rival.relation, tuple(Name(argument) for argument in rival.arguments)))

    def _if_newer(self, part: Formula, aspect: Aspect, *, news: Aspect | None = None, about: str | None = None) -> Iterator[Formula]:
        if self.provenance.time(aspect) > self.at:
            if not formula_holds(part, self.map, self.ontology):
                self.superseded.append(str(part))
        else:
            self._note(news or aspect, about)
            yield part

    def _note(self, aspect: Aspect, about: str | None) -> None:
        """There is news about the aspect; `about`: the object that is known by it, if it was unknown."""
        self.aspects.append(aspect)
        if about is not None and self.provenance.time((about, UNKNOWN)) <= self.at:
            self.asserted.add(about)
            self.aspects.append((about, UNKNOWN))

    def _coinciding(self, changes: Iterable[Change], map: Map) -> Iterator[Merging]:
        """Objects that are known from sightings only, and stand where the report puts an object that looks the same.

        A camera saw what a robot had put down before the robot said so.
        """
        moved = {change.object for change in changes if isinstance(change, ValueSet) and change.path.startswith("Position")}
        provisional = {name for name in self.provenance.provisional if name in map.objects} - self.mentioned
        for into in sorted(moved - provisional) if provisional else ():
            for name in coinciding(into, sorted(provisional), map, self.ontology):
                provisional.remove(name)
                self.mentioned.add(name)
                yield Merging(name=name, into=into)

    # What is not there

    def _searched_things(self) -> Iterator[str]:
        for area in self.observation.searched:
            yield from things_at(area, self.map, self.ontology)
        yield from (name for name in self.observation.missed if name in self.map.objects)

    def _missing(self) -> Iterator[str]:
        """The objects that the map has where the report searched, or missed them, and that the report does not mention."""
        for name in dict.fromkeys(self._searched_things()):
            aspects = [(name, UNKNOWN), *(location_aspect(fact, self.ontology) for fact in location_facts(name, self.map, self.ontology))]
            newer = any(aspect is not None and self.provenance.time(aspect) > self.at for aspect in aspects)
            if name not in self.mentioned and not newer and not self.ontology.is_subtype(self.map.objects[name].type, DEVICE):
                yield name

    def _unknown_changes(self, name: str) -> Iterator[Change]:
        for fact in location_facts(name, self.map, self.ontology):
            self.aspects.append(fact_aspect(fact, self.ontology))
            yield FactRemoved(fact)
        self.aspects.append((name, UNKNOWN))
        yield ValueSet(name, UNKNOWN, True)

    def _departures(self) -> Iterator[Change]:
        for name in dict.fromkeys(self.observation.gone):
            if name not in self.map.objects:
                continue  # it is known already
            if self.provenance.latest(name) > self.at:
                self.superseded.append(f"{name} is gone")
            else:
                yield ObjectRemoved(name)


def sightings_of(situation: Formula, map: Map, ontology: Ontology) -> list[Sighting]:
    """The sighted objects that the variables of a situation stand for, with the values and the place that it states.

    Raises FormulaError for a variable without a type of physical objects, and for a situation that does not say what holds.
    """
    stand_ins: dict[str, Object] = {}
    for name, variable in variables(situation).items():
        if variable.type is None or variable.type not in ontology.types:
            atom = next(atom for atom in atoms(situation) if name in variables(atom))
            hint = f"name an object of the map, or describe one that was seen by its type: ?{name}: Jar"
            raise read(str(situation)).error(atom, variable, f"?{name} is not bound", hint)
        if not ontology.is_subtype(variable.type, PHYSICAL) and not ontology.is_subtype(PHYSICAL, variable.type):
            atom = next(atom for atom in atoms(situation) if name in variables(atom))
            hint = "only physical objects are seen; name the object, or add it to the map"
            raise read(str(situation)).error(atom, variable, f"?{name} is no physical object: a {variable.type} is none", hint)
        stand_ins[name] = Object(name=_unused(f"seen-{name}", map), type=variable.type)
    described = substitute(situation, {variable: Name(object.name) for variable, object in stand_ins.items()})
    map_then = map.changed(ObjectAdded(object) for object in stand_ins.values())
    values = {
        (change.object, change.path): change.value for change in changes_by(described, map_then, ontology) if isinstance(change, ValueSet)
    }
    variable_of = {object.name: variable for variable, object in stand_ins.items()}
    stated: dict[str, dict[str, Value]] = {variable: {} for variable in stand_ins}
    places: dict[str, str] = {}
    for part in conjuncts(described):
        match part:
            case Comparison(Attribute(Name(name), path), "=") | Comparison(_, "=", Attribute(Name(name), path)) if name in variable_of:
                value = values.get((name, path), ontology.default(stand_ins[variable_of[name]].type, path))
                if value is not None:
                    stated[variable_of[name]][path] = value
            case Relation(relation, (Name(name), Name(place))) if name in variable_of and relation in exclusive_relations(ontology):
                places[variable_of[name]] = variable_of.get(place, place)
    return [
        Sighting(variable=variable, object=structs.replace(object, values=stated[variable]), place=places.get(variable))
        for variable, object in stand_ins.items()
    ]


def atoms(formula: Formula) -> Iterator[Atom]:
    return (literal.atom if isinstance(literal, Not) else literal for literal in literals(formula))


def free_name(type_name: str, names: Iterable[str]) -> str:
    """A name for a new object: its type and the number after the highest of the names of that form, as in `Jar007`."""
    numbers = (name.removeprefix(type_name) for name in names if name.startswith(type_name))
    return f"{type_name}{max((int(number) for number in numbers if number.isdecimal()), default=0) + 1:03d}"


def next_free_name(type_name: str, is_taken: Callable[[str], bool]) -> str:
    """A free name of that form, found in a few steps: the highest number is not looked for."""
    taken_number, free = 0, 1
    while is_taken(f"{type_name}{free:03d}"):
        taken_number, free = free, 2 * free
    while free - taken_number > 1:
        middle = (taken_number + free) // 2
        taken_number, free = (middle, free) if is_taken(f"{type_name}{middle:03d}") else (taken_number, middle)
    return f"{type_name}{free:03d}"


def location_facts(name: str, map: Map, ontology: Ontology) -> list[Fact]:
    """The facts that say what the object is on, in or held by."""
    return [Fact(relation, arguments) for relation in exclusive_relations(ontology) for arguments in map.facts_with(relation, 0, name)]


def things_at(area: str, map: Map, ontology: Ontology) -> Iterator[str]:
    """The objects that the map has on or in the area or its parts, and what is on or in them."""
    relations = (PART_OF, *exclusive_relations(ontology))
    pending, reached = [area], {area}
    while pending:
        whole = pending.pop()
        for relation in relations:
            for arguments in map.facts_with(relation, 1, whole):
                if arguments[0] not in reached:
                    reached.add(arguments[0])
                    pending.append(arguments[0])
                    if relation != PART_OF:
                        yield arguments[0]


def _fact(atom: Relation) -> Fact:
    return Fact(atom.relation, tuple(str(argument) for argument in atom.arguments))


def _unused(name: str, map: Map) -> str:
    while name in map.objects:
        name += "-"
    return name


def _is_placed_after(times: Mapping[str, float], time_seen: float) -> bool:
    """Whether any news of where the object is came after that time."""
    return any(time > time_seen and (aspect.startswith(("<", "Position"))) for aspect, time in times.items())

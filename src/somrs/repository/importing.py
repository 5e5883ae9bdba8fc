"""Brings the objects of neighbours onto the map, as the copies of their maps have them.

What a neighbour says of its own objects is not doubted, but it has to fit the ontology: an object that does not is left out, and why is
said. Definitions that the ontology lacks are taken over.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec import structs

from somrs.kernel.component import Effect, Effects, EffectsReturning, Input
from somrs.kernel.replica import ReplicaUpdate
from somrs.ontology.agreement import disagreements
from somrs.ontology.conformance import Violation, violations_of
from somrs.ontology.homes import renamed_fact, renamed_object
from somrs.ontology.map import Map
from somrs.ontology.naming import Renaming, Section, find_definition, key_of
from somrs.ontology.objects import Change, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet, objects_of
from somrs.ontology.qualified_names import home_of, plain_name, translated
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Definition
from somrs.protocol.messages.knowledge import Define, Merging, by_kind
from somrs.repository.brought_definitions import brought_outcome
from somrs.repository.committing import Committing
from somrs.repository.neighbour_state import NeighbourState
from somrs.repository.outcome import Outcome
from somrs.repository.publishing import Publishing
from somrs.repository.state import Contents


class Importing:
    """Changes the contents as the maps of neighbours change. It has no state of its own."""

    def __init__(self, contents: Contents, committing: Committing, publishing: Publishing) -> None:
        self._contents, self._committing, self._publishing = contents, committing, publishing

    def handle(self, event: Input, now: float) -> list[Effect] | None:
        """Handle an input; None if it does not concern the copy of a neighbour's map."""
        for neighbour in self._contents.neighbours.values():
            update = neighbour.copy.handle(event, now)
            if update is not None:
                return [*update.effects, *self._follow(neighbour, update, now)]
        return None

    def add_postponed(self, neighbour: NeighbourState, now: float) -> Effects:
        """Add the objects that had to wait for the end of a handover."""
        names, neighbour.postponed = [*neighbour.postponed], {}
        yield from self._take_over(neighbour, names, (), (), now)

    def refresh(self, neighbour: NeighbourState, name: str, now: float) -> Effects:
        """Have an object, and what is said of it, as the copy has it."""
        yield from self._take_over(neighbour, [name, *_subjects_about(neighbour, name)], (), (), now)

    def remove_all(self, home: str, now: float) -> Effects:
        """Remove the objects of a neighbour."""
        names = [name for name in self._contents.map.objects if home_of(name) == home]
        facts = dict.fromkeys(fact for name in names for fact in self._contents.map.facts_about(name))
        yield from self._commit(home, (*map(FactRemoved, facts), *map(ObjectRemoved, names)), (), (), now)

    def _follow(self, neighbour: NeighbourState, update: ReplicaUpdate, now: float) -> Effects:
        copy = neighbour.copy
        if update.reloaded:
            yield from self._define(neighbour, copy.ontology, now)
            neighbour.adopted = {name: None for name in neighbour.adopted if name in copy.map.objects and name in copy.leaving}
            imported_names = (plain_name(name) for name in self._contents.map.objects if home_of(name) == copy.map_name)
            yield from self._take_over(neighbour, dict.fromkeys((*copy.map.objects, *imported_names)), update.renamed, update.merged, now)
        if update.definitions:
            yield from self._define(neighbour, update.definitions, now)
        if not update.reloaded and (update.changes or update.renamed or update.merged):
            for change in update.changes:
                if isinstance(change, ObjectRemoved):
                    neighbour.adopted.pop(change.name, None)
            names = [objects_of(change)[0] for change in update.changes if objects_of(change)]
            yield from self._take_over(neighbour, dict.fromkeys(names), update.renamed, update.merged, now)
        yield from self._settle_expected(neighbour, now)

    def _settle_expected(self, neighbour: NeighbourState, now: float) -> Effects:
        """Remove what should have its home at the neighbour if that does not show it."""
        copy, expected = neighbour.copy, neighbour.expected
        hidden_names = [name for name, since in expected.items() if copy.is_current and copy.known_since > since]
        for name in hidden_names:
            del expected[name]
        yield from self._take_over(neighbour, hidden_names, (), (), now)

    def _expect(self, neighbour: NeighbourState, renamings: Iterable[Renaming], now: float) -> EffectsReturning[list[Change]]:
        """Returns the changes by which objects that the neighbour has given away are had under their new names.

        Their new homes may say so later, or not at all.
        """
        map, changes = self._contents.map, list[Change]()
        for renaming in renamings:
            new_home = self._contents.neighbours.get(home_of(renaming.to))
            if new_home is None or new_home is neighbour or renaming.name not in map.objects or renaming.to in map.objects:
                continue
            new_home.expected[plain_name(renaming.to)] = now
            yield from new_home.copy.ask_version(now)
            changes += _under_new_name(map, renaming)
        return changes

    def _define(self, neighbour: NeighbourState, definitions: Iterable[Definition], now: float) -> Effects:
        """Take over what the ontology lacks. Service types come with the offers of services."""
        ontology, home = self._contents.ontology, neighbour.settings.map
        lacking: list[Definition] = []
        for definition in definitions:
            existing = find_definition(ontology, key_of(definition))
            neighbour.disagreements.pop(str(key_of(definition)), None)
            if isinstance(definition, ServiceType):
                continue
            if existing is None:
                lacking.append(definition)
            elif reasons := disagreements(definition, existing):
                neighbour.disagreements[str(key_of(definition))] = "; ".join(reasons)
        if not lacking:
            return
        outcome = brought_outcome(self._contents, Define(definitions=by_kind(lacking), author=home, brought=True))
        if outcome.broken:
            neighbour.disagreements |= {violation.subject: violation.message for violation in outcome.broken}
        else:
            news = yield from self._committing.commit(outcome, home, now)
            yield from self._publishing.publish(news, now)

    def _take_over(
        self,
        neighbour: NeighbourState,
        names: Iterable[str],
        renamed: tuple[Renaming, ...],
        merged: tuple[Merging, ...],
        now: float,
    ) -> Effects:
        """Have these objects as the copy has them. `names`: at the neighbour."""
        own_names = [name for name in names if not home_of(name)]
        for name in own_names:
            neighbour.omissions.pop(name, None)
            if name in neighbour.copy.map.objects:
                neighbour.expected.pop(name, None)
        own_names = [name for name in own_names if name not in neighbour.expected]
        if any(handover.map == neighbour.settings.map for handover in self._contents.handovers.values()):
            new_names = [name for name in own_names if self._name(neighbour, name) not in self._contents.map.objects]
            neighbour.postponed.update(dict.fromkeys(new_names))
            own_names = [name for name in own_names if name not in neighbour.postponed]
        renamings = tuple(
            Renaming(section=Section.OBJECTS, name=self._name(neighbour, renaming.name), to=self._name(neighbour, renaming.to))
            for renaming in renamed
            if renaming.section is Section.OBJECTS
        )
        given_away = yield from self._expect(neighbour, renamings, now)
        changes = self._fitting(neighbour, [*self._differences(neighbour, own_names), *given_away])
        mergings = tuple(Merging(name=self._name(neighbour, merging.name), into=self._name(neighbour, merging.into)) for merging in merged)
        yield from self._commit(neighbour.settings.map, changes, renamings, mergings, now)
        yield from self._complete(neighbour, self._added(changes), now)

    def _complete(self, source: NeighbourState, added_names: Iterable[str], now: float) -> Effects:
        """Have what other neighbours say of objects that this one has added."""
        for neighbour in self._contents.neighbours.values():
            if neighbour is not source:
                map = neighbour.settings.map
                names = (translated(name, self._contents.map.name, map) for name in sorted(added_names))
                if subjects := dict.fromkeys(subject for name in names for subject in _subjects_about(neighbour, name)):
                    yield from self._take_over(neighbour, subjects, (), (), now)

    def _commit(
        self, home: str, changes: tuple[Change, ...], renamed: tuple[Renaming, ...], merged: tuple[Merging, ...], now: float
    ) -> Effects:
        contents = self._contents
        map_after = contents.map.changed(changes)
        new_holders = (*(renaming.to for renaming in renamed), *(merging.into for merging in merged))
        if any(name not in map_after.objects for name in new_holders):
            renamed, merged = (), ()  # what has the name now is not known here
        # When it held is known at its home, which decides what is newer: here it is no news as of a time.
        outcome = Outcome(map=map_after, ontology=contents.ontology, changes=changes, renamed=renamed, merged=merged, at=now)
        if changes:
            news = yield from self._committing.commit(outcome, home, now)
            yield from self._publishing.publish(news, now)

    def _name(self, neighbour: NeighbourState, name: str) -> str:
        """The name here of an object with this name at the neighbour."""
        return translated(name, neighbour.settings.map, self._contents.map.name)

    # What differs

    def _differences(self, neighbour: NeighbourState, names: list[str]) -> Iterator[Change]:
        """The changes to what the copy has of these objects, and of the facts that begin with them."""
        own_map, copied_map = self._contents.map, neighbour.copy.map
        existing_names = [name for name in names if name in copied_map.objects and name not in neighbour.adopted]
        new_objects: list[Object] = []
        values: list[Change] = []
        removed_names = [
            self._name(neighbour, name) for name in names if name not in existing_names and self._name(neighbour, name) in own_map.objects
        ]
        for name in existing_names:
            object = renamed_object(copied_map.objects[name], lambda name: self._name(neighbour, name))
            old_object = own_map.objects.get(object.name)
            if old_object is not None and old_object.type != object.type:
                removed_names.append(object.name)
            if old_object is None or old_object.type != object.type:
                new_objects.append(object)
            else:
                values += (
                    ValueSet(object.name, path, object.values.get(path))
                    for path in {**old_object.values, **object.values}
                    if old_object.values.get(path) != object.values.get(path)
                )
        # Facts that could not be had as long as an object in them was not there.
        subjects = dict.fromkeys(existing_names)
        for object in new_objects:
            subjects.update(dict.fromkeys(fact.arguments[0] for fact in copied_map.facts_about(plain_name(object.name))))
        old_facts = dict.fromkeys(fact for name in names for fact in own_map.facts_from(self._name(neighbour, name)))
        old_facts.update(dict.fromkeys(fact for name in removed_names for fact in own_map.facts_about(name)))
        new_facts = dict.fromkeys(
            renamed_fact(fact, lambda name: self._name(neighbour, name))
            for subject in subjects
            if not home_of(subject)
            for fact in copied_map.facts_from(subject)
        )
        yield from (FactRemoved(fact) for fact in old_facts if fact not in new_facts or not {*removed_names}.isdisjoint(fact.arguments))
        yield from map(ObjectRemoved, removed_names)
        yield from map(ObjectAdded, new_objects)
        yield from values
        yield from (FactAdded(fact) for fact in new_facts if fact not in old_facts or not {*removed_names}.isdisjoint(fact.arguments))

    def _fitting(self, neighbour: NeighbourState, changes: list[Change]) -> tuple[Change, ...]:
        """The changes without what does not fit the ontology."""
        contents = self._contents
        while True:
            changes = [*self._possible(neighbour, changes)]
            touched = {name for change in changes for name in objects_of(change)}
            broken = violations_of(contents.map.changed(changes), contents.ontology, touched, contents.map)
            doubtful = [violation for violation in broken if self._is_about(violation, changes)]
            if not doubtful:
                return tuple(changes)
            changes = self._without(neighbour, changes, doubtful[0])

    def _is_about(self, violation: Violation, changes: list[Change]) -> bool:
        """Whether one of the changes says something of the subject, so that it can be left out."""
        return any(violation.subject == _subject(change) or violation.subject == objects_of(change)[0] for change in changes)

    def _without(self, neighbour: NeighbourState, changes: list[Change], violation: Violation) -> list[Change]:
        """The changes without the subject of the violation: an object that is not there yet, or what is said of it."""
        subject = violation.subject
        neighbour.omissions[plain_name(subject) if subject in self._added(changes) else subject] = violation.message
        return [change for change in changes if _subject(change) != subject and objects_of(change)[0] != subject]

    def _added(self, changes: Iterable[Change]) -> set[str]:
        return {change.object.name for change in changes if isinstance(change, ObjectAdded)}

    def _possible(self, neighbour: NeighbourState, changes: list[Change]) -> Iterator[Change]:
        """The changes about objects that are there, with types and relations that the ontology has."""
        ontology, present = self._contents.ontology, dict[str, bool]()
        for change in changes:
            match change:
                case ObjectAdded(object) if object.type not in ontology.types:
                    neighbour.omissions[plain_name(object.name)] = f"the type {object.type} is not defined here"
                    continue
                case ObjectAdded(object):
                    present[object.name] = True
                case ObjectRemoved(name):
                    present[name] = False
                case FactAdded(fact) if fact.relation not in ontology.relations:
                    continue
                case FactAdded(fact):
                    if not all(present.get(name, name in self._contents.map.objects) for name in fact.arguments):
                        continue
                case ValueSet(name) if not present.get(name, name in self._contents.map.objects):
                    continue
            yield change


def _subjects_about(neighbour: NeighbourState, name: str) -> Iterator[str]:
    """The objects of the neighbour about which it has facts with an object of this name."""
    return (fact.arguments[0] for fact in neighbour.copy.map.facts_about(name) if not home_of(fact.arguments[0]))


def _subject(change: Change) -> str:
    """What a violation by the change may name: a fact, or an object."""
    return str(change.fact) if isinstance(change, FactAdded | FactRemoved) else objects_of(change)[0]


def _under_new_name(map: Map, renaming: Renaming) -> Iterator[Change]:
    """The changes that add an object of the map again, with what is said of it, under its new name."""
    yield ObjectAdded(structs.replace(map.objects[renaming.name], name=renaming.to))
    for fact in map.facts_about(renaming.name):
        yield FactAdded(renamed_fact(fact, lambda name: renaming.to if name == renaming.name else name))

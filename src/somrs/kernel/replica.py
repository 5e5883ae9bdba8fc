"""A copy of the Repository's ontology and map, for components that plan or decide on them. How it is followed is in `following.py`."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from msgspec import Struct, field

from somrs.kernel.component import Effect, Input
from somrs.kernel.following import LEASE, Following, Reading
from somrs.ontology.map import Map
from somrs.ontology.naming import DefinitionKey, Renaming, Section, revise_ontology
from somrs.ontology.objects import Change, Fact, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import Definition, Ontology
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.knowledge import (
    MapChanged,
    MapPage,
    MapSubscribed,
    Merging,
    OntologyChanged,
    OntologyPage,
    ReadMap,
    ReadOntology,
    SubscribeMap,
    new_names_of,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplicaUpdate:
    """The result of an input: `effects` to carry out, and how the copy changed.

    `changes` of the map and names that were `renamed` are in order. `merged`: objects that turned out to be others. `new_names`: the names
    that objects have now, by the names that they lost. `definitions` are new or revised; `removed` are gone or have another name.
    `reloaded`: the whole copy was read again, so that anything may have changed before `changes`; `renamed` has what got another name.
    """

    effects: list[Effect]
    changes: tuple[Change, ...] = ()
    definitions: tuple[Definition, ...] = ()
    removed: tuple[DefinitionKey, ...] = ()
    renamed: tuple[Renaming, ...] = ()
    merged: tuple[Merging, ...] = ()
    new_names: Mapping[str, str] = dataclasses.field(default_factory=dict)
    reloaded: bool = False

    @property
    def ontology_changed(self) -> bool:
        """Whether the ontology may have changed."""
        return bool(self.definitions or self.removed or self.reloaded)


class MapReading(Reading, kw_only=True):
    """The pages read so far. `changed_at` is the version in which the ontology last changed before its first page."""

    changed_at: int | None = None
    ontology: Ontology = field(default_factory=Ontology)
    objects: list[Object] = field(default_factory=list)
    facts: list[Fact] = field(default_factory=list)
    map_name: str = ""
    former_names: dict[str, str] = field(default_factory=dict)


class ReplicaDue(Struct, frozen=True, tag=True):
    """The timer of a component's replica."""


class Replica(Following[MapChanged | OntologyChanged, MapReading]):
    """`ontology` and `map` are the Repository's as far as received. The owner passes every input to `handle` first.

    `own`: the map has only objects that have their home there, and none of the Repository's neighbours. `complete`: the maps of which the
    Repository shows all objects.
    """

    SUBSCRIBED = MapSubscribed
    QUESTIONS = (SubscribeMap, ReadMap, ReadOntology)
    PAGES = (OntologyPage, MapPage)
    EVENTS = (MapChanged, OntologyChanged)

    owner: str
    repository: str
    ontology: Ontology = field(default_factory=Ontology)
    map: Map = field(default_factory=Map)
    own: bool = False
    complete: tuple[str, ...] = ()
    missed_names: dict[str, str] = field(default_factory=dict)
    """What objects are called now, by the names that they had before everything was read again; until that is reported."""

    def handle(self, event: Input, now: float) -> ReplicaUpdate | None:
        """Handle an input; None if it does not concern the replica."""
        followed = self.follow(event, now)
        return self._update(followed.effects, followed.events, followed.reloaded) if followed is not None else None

    @property
    def timer(self) -> Any:
        return ReplicaDue()

    @property
    def publisher(self) -> str:
        return self.repository

    def _subscription(self) -> Body:
        return SubscribeMap(lease=LEASE, own=self.own)

    def _new_reading(self) -> MapReading:
        return MapReading()

    def _first_question(self) -> Body:
        return ReadOntology()

    def _subscribed(self, answer: MapSubscribed, now: float) -> list[Effect]:
        if answer.complete != self.complete:
            self.complete = answer.complete
            self.map = self.map.completed(self.complete)
        return super()._subscribed(answer, now)

    def _version_of(self, event: MapChanged | OntologyChanged) -> int:
        return event.event.version if isinstance(event, MapChanged) else event.version

    def _is_out_of_place(self, reading: MapReading, page: OntologyPage | MapPage) -> bool:
        # Pages of the ontology are addressed by position, and the positions may have changed.
        return isinstance(page, OntologyPage) and reading.changed_at != page.changed_at

    def _add_page(self, reading: MapReading, page: OntologyPage | MapPage) -> Body | None:
        if isinstance(page, OntologyPage):
            reading.changed_at = page.changed_at
            reading.ontology = reading.ontology.extended(page.definitions.all_definitions())
            return ReadOntology(after=page.next) if page.more else ReadMap(own=self.own)
        reading.objects += page.objects
        reading.facts += page.facts
        reading.map_name = page.map
        reading.former_names |= page.former_names
        return ReadMap(after=page.objects[-1].name, own=self.own) if page.more else None

    def _adopt(self, reading: MapReading, now: float) -> None:
        map_before = self.map
        self.ontology, self.map = reading.ontology, Map(reading.objects, reading.facts, reading.map_name, self.complete)
        self.missed_names = {
            name: new_name for name, new_name in reading.former_names.items() if name in map_before.objects and name not in self.map.objects
        }

    def _update(self, effects: list[Effect], events: tuple[MapChanged | OntologyChanged, ...], reloaded: bool) -> ReplicaUpdate:
        """Apply the events."""
        changes: list[Change] = []
        definitions: list[Definition] = []
        removed: list[DefinitionKey] = []
        new_names, self.missed_names = self.missed_names, {}
        renamed = [Renaming(section=Section.OBJECTS, name=name, to=new_name) for name, new_name in new_names.items()]
        merged: list[Merging] = []
        for event in events:
            change_event = event.event if isinstance(event, MapChanged) else event
            renamed += change_event.renamed
            applied = [*_applicable(self.map, change_event.changes)]
            if applied:
                self.map = self.map.changed(applied)
                changes += applied
            lost_names = new_names_of(change_event.renamed, event.event.merged if isinstance(event, MapChanged) else ())
            if isinstance(event, MapChanged):
                merged += event.event.merged
            else:
                definitions += event.definitions.all_definitions()
                removed += event.removed
                self.ontology = revise_ontology(self.ontology, event.removed, event.definitions.all_definitions())
            new_names = {name: lost_names.get(to, to) for name, to in new_names.items()} | lost_names
        return ReplicaUpdate(
            effects=effects,
            changes=tuple(changes),
            definitions=tuple(definitions),
            removed=tuple(removed),
            renamed=tuple(renamed),
            merged=tuple(merged),
            new_names=new_names,
            reloaded=reloaded,
        )


def _applicable(map: Map, changes: Iterable[Change]) -> Iterator[Change]:
    """The changes, without values of objects that are gone: a page may be newer than the event that is applied to it."""
    presence: dict[str, bool] = {}
    for change in changes:
        match change:
            case ObjectAdded(object):
                presence[object.name] = True
            case ObjectRemoved(name):
                presence[name] = False
            case ValueSet(name) if not presence.get(name, name in map.objects):
                continue
        yield change

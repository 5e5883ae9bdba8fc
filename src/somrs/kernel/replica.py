"""A copy of the Repository's ontology and map, for components that plan or decide on them.

The replica subscribes first, and then reads page by page; changes in the meantime arrive as events. An event states new values, not
differences, so it may be applied to a page that already includes it: the last event wins. A lost message shows as a gap between
versions. If the gap does not close, the replica reads everything again.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from msgspec import Struct, field

from somrs.kernel.component import DeliveryFailed, Effect, Input, Received, Send, SetTimer, TimerFired
from somrs.ontology.naming import DefinitionKey, Renaming, revise_ontology
from somrs.ontology.objects import Change, Fact, Map, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import Definition, Ontology
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Fault
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

LEASE = 60.0
"""Seconds that a subscription lasts; the replica renews it after a third of that time."""

PATIENCE = 5.0
"""Seconds without an answer after which the replica subscribes again."""

GAP_TIME = 1.0
"""Seconds after which a missing message counts as lost, not as out of order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplicaUpdate:
    """The result of an input: `effects` to carry out, and how the copy changed.

    `changes` of the map and names that were `renamed` are in order. `merged`: objects that turned out to be others. `new_names`: the names
    that objects have now, by the names that they lost. `definitions` are new or revised; `removed` are gone or have another name.
    `reloaded`: the whole copy was read again, so that anything may have changed before `changes`.
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


class _Reading(Struct, kw_only=True):
    """The pages read so far.

    `first_version` is the map's version at the first page, `last_version` that at the latest page. `changed_at` is the version in which
    the ontology last changed before its first page.
    """

    first_version: int | None = field(default=None, name="first")
    last_version: int = field(default=0, name="last")
    changed_at: int | None = None
    ontology: Ontology = field(default_factory=Ontology)
    objects: list[Object] = field(default_factory=list)
    facts: list[Fact] = field(default_factory=list)
    complete: bool = False


class ReplicaDue(Struct, frozen=True, tag=True):
    """The timer of a component's replica."""


class Replica(Struct):
    """`ontology`, `map` and `version` are the Repository's as far as received; `ready` becomes true when they have been read.

    `confirmed`: whether the Repository has stated its version since the owner started, so that it is known how much the copy lacks.

    The owner passes every input to `handle` first, and carries out the effects. The replica uses one timer, `ReplicaDue`.
    """

    owner: str
    repository: str
    ontology: Ontology = field(default_factory=Ontology)
    map: Map = field(default_factory=Map)
    version: int = -1
    source: str = ""
    """The address that the Repository gives itself. `repository` may be another name of the same address."""
    events: dict[int, MapChanged | OntologyChanged] = {}
    announced_version: int = field(default=-1, name="announced")
    """The latest version that a message mentioned."""
    reading: _Reading | None = None
    question_count: int = field(default=0, name="asked")
    question: str | None = None
    subscription: str | None = None
    subscribed_at: int = -1
    answer_by: float | None = None
    gap_until: float | None = None
    renew_at: float = 0.0
    confirmed: bool = True

    @property
    def ready(self) -> bool:
        return self.version >= 0

    @property
    def is_current(self) -> bool:
        """Whether nothing is known to be missing."""
        return self.ready and self.confirmed and self.announced_version <= self.version

    def start(self, now: float) -> list[Effect]:
        """Subscribe. The reply starts the reading, or tells how much the copy lacks."""
        self.confirmed = False
        return [self._subscribe(now), self._next_timer()]

    def handle(self, event: Input, now: float) -> ReplicaUpdate | None:
        """Handle an input; None if it does not concern the replica."""
        match event:
            case Received(message):
                effects = self._received(message, now)
            case DeliveryFailed(message):
                effects = self._delivery_failed(message, now)
            case TimerFired(ReplicaDue()):
                effects = self._check_deadlines(now)
            case _:
                effects = None
        return None if effects is None else self._catch_up(effects, now)

    # Requests

    def _subscribe(self, now: float) -> Send:
        self.renew_at = now + LEASE / 3
        self.subscribed_at = self.version
        send = self._ask(SubscribeMap(lease=LEASE), now)
        self.subscription = send.message.header.message_id
        return send

    def _read(self, body: ReadOntology | ReadMap, now: float) -> Send:
        send = self._ask(body, now)
        self.question = send.message.header.message_id
        return send

    def _ask(self, body: Body, now: float) -> Send:
        # The time is part of the id, so that an owner that lost its state does not use earlier ids again.
        self.question_count += 1
        identity = message_id(self.owner, self.repository, "replica", self.question_count, now)
        header = Header(sender=self.owner, recipient=self.repository, message_id=identity, reply_to=self.owner)
        self.answer_by = now + PATIENCE
        return Send(Message(header=header, body=body), expires_at=now + PATIENCE)

    def _begin_reading(self, now: float) -> list[Effect]:
        self.reading = _Reading()
        return [self._read(ReadOntology(), now)]

    def _give_up_reading(self, now: float) -> list[Effect]:
        """Subscribe again: the reply states the Repository's current version."""
        self.reading = self.question = None
        return [self._subscribe(now)]

    def _check_deadlines(self, now: float) -> list[Effect]:
        if self.answer_by is not None and self.answer_by <= now:
            return self._give_up_reading(now)
        if self.gap_until is not None and self.gap_until <= now:
            return self._begin_reading(now)
        return [self._subscribe(now)] if self.renew_at <= now else []

    def _delivery_failed(self, message: Message, now: float) -> list[Effect] | None:
        ours = isinstance(message.body, SubscribeMap | ReadMap | ReadOntology) and message.header.recipient == self.repository
        if ours and message.header.message_id in (self.question, self.subscription):
            self.answer_by = now + GAP_TIME
        return [] if ours else None

    # Messages

    def _received(self, message: Message, now: float) -> list[Effect] | None:
        """The immediate effects of a message; `_catch_up` applies the events that it completes."""
        request_id = message.header.relates_to
        match message.body:
            case MapSubscribed(version=version) if request_id is not None and request_id == self.subscription:
                self.source = message.header.sender
                return self._subscribed(version, now)
            case OntologyPage() | MapPage() as page if self.reading is not None and request_id is not None and request_id == self.question:
                return self._page(self.reading, page, now)
            case Fault() if request_id is not None and request_id in (self.question, self.subscription):
                return []  # the request is repeated after `PATIENCE`
            case _ if message.header.sender not in (self.source or self.repository, self.repository):
                return None
            case MapChanged() as changed:
                self._record_event(changed.event.version, changed)
                return []
            case OntologyChanged() as changed:
                self._record_event(changed.version, changed)
                return []
            case MapSubscribed() if request_id is None:
                # The Repository restarted, or a change was too large for a message: request its current version.
                return [self._subscribe(now)]
            case MapSubscribed() | OntologyPage() | MapPage():
                return []  # the reply to an abandoned request
            case _:
                return None

    def _record_event(self, version: int, event: MapChanged | OntologyChanged) -> None:
        self.events[version] = event
        self.announced_version = max(self.announced_version, version)

    def _subscribed(self, version: int, now: float) -> list[Effect]:
        self.subscription, self.confirmed = None, True
        if self.reading is None:
            self.answer_by = None
        if version < self.subscribed_at:  # its store was restored from a backup or is new: this copy is of another map
            self.version = self.announced_version = -1
            self.events.clear()
            self.reading = None
        self.announced_version = max(self.announced_version, version)
        return self._begin_reading(now) if not self.ready and self.reading is None else []

    def _page(self, reading: _Reading, page: OntologyPage | MapPage, now: float) -> list[Effect]:
        self.question = self.answer_by = None
        if reading.first_version is None:
            reading.first_version = page.version
        elif page.version < reading.last_version:
            return self._give_up_reading(now)
        reading.last_version = page.version
        match page:
            case OntologyPage(changed_at=changed_at) if reading.changed_at not in (None, changed_at):
                return self._give_up_reading(now)  # pages are addressed by position, and the positions have changed
            case OntologyPage():
                reading.changed_at = page.changed_at
                reading.ontology = reading.ontology.extended(page.definitions.all_definitions())
                return [self._read(ReadOntology(after=page.next) if page.more else ReadMap(), now)]
            case MapPage():
                reading.objects += page.objects
                reading.facts += page.facts
                if page.more:
                    return [self._read(ReadMap(after=page.objects[-1].name), now)]
        reading.complete = True
        self.announced_version = max(self.announced_version, reading.last_version)
        return []

    # Events

    def _catch_up(self, effects: list[Effect], now: float) -> ReplicaUpdate:
        """Apply the received events, up to the first gap."""
        old_version = self.version
        read = self._adopt()
        changes: list[Change] = []
        definitions: list[Definition] = []
        removed: list[DefinitionKey] = []
        renamed: list[Renaming] = []
        merged: list[Merging] = []
        new_names: dict[str, str] = {}
        while self.ready and (event := self.events.get(self.version + 1)) is not None:
            self.version += 1
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
        self._forget()
        self._watch_gap(self.version != old_version, now)
        return ReplicaUpdate(
            effects=[*effects, self._next_timer()],
            changes=tuple(changes),
            definitions=tuple(definitions),
            removed=tuple(removed),
            renamed=tuple(renamed),
            merged=tuple(merged),
            new_names=new_names,
            reloaded=read,
        )

    def _adopt(self) -> bool:
        """Make the pages the copy, if all events between the versions of the first and the last page have arrived."""
        reading = self.reading
        if reading is None or not reading.complete or reading.first_version is None:
            return False
        if any(version not in self.events for version in range(reading.first_version + 1, reading.last_version + 1)):
            return False
        self.ontology, self.map = reading.ontology, Map(reading.objects, reading.facts)
        self.version = reading.first_version
        self.reading = None
        return True

    def _forget(self) -> None:
        """Drop the events that neither the copy nor the pages being read need."""
        reached = self.version
        if self.reading is not None:
            reached = min(reached, self.reading.first_version if self.reading.first_version is not None else -1)
        self.events = {version: event for version, event in self.events.items() if version > reached}

    def _watch_gap(self, moved: bool, now: float) -> None:
        is_lagging = self.ready and self.announced_version > self.version
        waiting = is_lagging if self.reading is None else self.reading.complete
        if not waiting:
            self.gap_until = None
        elif moved or self.gap_until is None or self.gap_until <= now:
            self.gap_until = now + GAP_TIME

    def _next_timer(self) -> SetTimer:
        return SetTimer(ReplicaDue(), min(time for time in (self.renew_at, self.answer_by, self.gap_until) if time is not None))


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

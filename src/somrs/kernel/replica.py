"""A copy of the ontology and the map that follows the Repository's, kept by whoever plans or decides on them.

First it subscribes, then it reads page by page; what changes meanwhile comes as events. Every change says what is, not by how
much, so that events which a later page already shows may be put on it again: whoever was last still wins. A message that was
lost shows as a gap between versions. If the gap does not close by itself, everything is read again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
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
    OntologyChanged,
    OntologyPage,
    ReadMap,
    ReadOntology,
    SubscribeMap,
)

LEASE = 60.0
"""Seconds that a subscription lasts; it is renewed after a third of them."""

PATIENCE = 5.0
"""Seconds after which a question without an answer is asked anew."""

GAP_TIME = 1.0
"""Seconds that messages may overtake each other by, before one that is missing counts as lost."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplicaUpdate:
    """What came of an input: `effects` to carry out; the `changes` of the map, in order; the `definitions` that are new, and those that
    were `removed` or have other names now; and what was `renamed`, in order. `reloaded`: the copy was read as a whole; before `changes`,
    anything may have changed."""

    effects: list[Effect]
    changes: tuple[Change, ...] = ()
    definitions: tuple[Definition, ...] = ()
    removed: tuple[DefinitionKey, ...] = ()
    renamed: tuple[Renaming, ...] = ()
    reloaded: bool = False

    @property
    def ontology_changed(self) -> bool:
        """Whether the ontology may be another one than before."""
        return bool(self.definitions or self.removed or self.reloaded)


class _Reading(Struct, kw_only=True):
    """The pages so far: `first_version` is the version of the first one, `last_version` the latest version among them, `changed_at` that in
    which the ontology changed last before its first page."""

    first_version: int | None = field(default=None, name="first")
    last_version: int = field(default=0, name="last")
    changed_at: int | None = None
    ontology: Ontology = field(default_factory=Ontology)
    objects: list[Object] = field(default_factory=list)
    facts: list[Fact] = field(default_factory=list)
    complete: bool = False


class ReplicaDue(Struct, frozen=True, tag=True):
    """The timer of a component's copy."""


class Replica(Struct):
    """`ontology`, `map` and `version` are the Repository's as far as is known here; `ready` once they were read.

    The owner hands every input to `handle` first, and carries out the effects. `ReplicaDue` is the one timer that is used.
    """

    owner: str
    repository: str
    ontology: Ontology = field(default_factory=Ontology)
    map: Map = field(default_factory=Map)
    version: int = -1
    source: str = ""
    """What the Repository calls itself; it may be known here by another name for the same address."""
    events: dict[int, MapChanged | OntologyChanged] = {}
    announced_version: int = field(default=-1, name="announced")
    """The latest version heard of."""
    reading: _Reading | None = None
    question_count: int = field(default=0, name="asked")
    question: str | None = None
    subscription: str | None = None
    subscribed_at: int = -1
    answer_by: float | None = None
    gap_until: float | None = None
    renew_at: float = 0.0

    @property
    def ready(self) -> bool:
        return self.version >= 0

    def start(self, now: float) -> list[Effect]:
        """Subscribe; everything else follows from the answer."""
        return [self._subscribe(now), self._next_timer()]

    def handle(self, event: Input, now: float) -> ReplicaUpdate | None:
        """What came of the input; None when it is no business of the replica."""
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

    # Asking

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
        # The time is part of the id: what was asked in an earlier life of the owner is another question.
        self.question_count += 1
        identity = message_id(self.owner, self.repository, "replica", self.question_count, now)
        header = Header(sender=self.owner, recipient=self.repository, message_id=identity, reply_to=self.owner)
        self.answer_by = now + PATIENCE
        return Send(Message(header=header, body=body), expires_at=now + PATIENCE)

    def _begin_reading(self, now: float) -> list[Effect]:
        self.reading = _Reading()
        return [self._read(ReadOntology(), now)]

    def _give_up_reading(self, now: float) -> list[Effect]:
        """Begin anew with the subscription, which tells the version that the Repository is at."""
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

    # Hearing

    def _received(self, message: Message, now: float) -> list[Effect] | None:
        """What to do at once; whatever follows from having heard more is done by `_catch_up`."""
        request_id = message.header.relates_to
        match message.body:
            case MapSubscribed(version=version) if request_id is not None and request_id == self.subscription:
                self.source = message.header.sender
                return self._subscribed(version, now)
            case OntologyPage() | MapPage() as page if self.reading is not None and request_id is not None and request_id == self.question:
                return self._page(self.reading, page, now)
            case Fault() if request_id is not None and request_id in (self.question, self.subscription):
                return []  # asked anew when patience is out
            case _ if message.header.sender not in (self.source or self.repository, self.repository):
                return None
            case MapChanged() as changed:
                self._record_event(changed.event.version, changed)
                return []
            case OntologyChanged() as changed:
                self._record_event(changed.version, changed)
                return []
            case MapSubscribed() if request_id is None:
                # The Repository came up again, or something changed that no message can hold: see where it is.
                return [self._subscribe(now)]
            case MapSubscribed() | OntologyPage() | MapPage():
                return []  # the answer to a question that was given up
            case _:
                return None

    def _record_event(self, version: int, event: MapChanged | OntologyChanged) -> None:
        self.events[version] = event
        self.announced_version = max(self.announced_version, version)

    def _subscribed(self, version: int, now: float) -> list[Effect]:
        self.subscription = None
        if self.reading is None:
            self.answer_by = None
        if version < self.subscribed_at:  # its store was put back or begun anew: what is known here belongs to another map
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
                return self._give_up_reading(now)  # the pages are counted, and what is counted is another list now
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

    # Following

    def _catch_up(self, effects: list[Effect], now: float) -> ReplicaUpdate:
        """Bring the copy as far as what was heard goes."""
        old_version = self.version
        read = self._adopt()
        changes: list[Change] = []
        definitions: list[Definition] = []
        removed: list[DefinitionKey] = []
        renamed: list[Renaming] = []
        while self.ready and (event := self.events.get(self.version + 1)) is not None:
            self.version += 1
            change_event = event.event if isinstance(event, MapChanged) else event
            renamed += change_event.renamed
            applied = [*_applicable(self.map, change_event.changes)]
            if applied:
                self.map = self.map.changed(applied)
                changes += applied
            if isinstance(event, OntologyChanged):
                definitions += event.definitions.all_definitions()
                removed += event.removed
                self.ontology = revise_ontology(self.ontology, event.removed, event.definitions.all_definitions())
        self._forget()
        self._watch_gap(self.version != old_version, now)
        return ReplicaUpdate(
            effects=[*effects, self._next_timer()],
            changes=tuple(changes),
            definitions=tuple(definitions),
            removed=tuple(removed),
            renamed=tuple(renamed),
            reloaded=read,
        )

    def _adopt(self) -> bool:
        """Take the pages as the copy, if every event is there that leads from the first to the last of them."""
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
        """Drop the events that neither the copy nor the pages being read need any more."""
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
    """The changes but for values of objects that are gone: a page may show more than the event that is put on it knew."""
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

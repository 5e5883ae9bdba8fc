"""The Repository: the common ontology and a map of the environment, for all who ask, change and follow them.

Paper, "Repository": a realisation of the common knowledge of the environment's representation, and a storage of its maps.
What an update comes to is `update.py`'s, what a change of the ontology `definition.py`'s, what undoing one `undoing.py`'s; what happened
and how things were is `history_queries.py`'s, how answers are cut into pages `pages.py`'s, what is on disk `entries.py`'s.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import islice

from msgspec import structs

from somrs.errors import InputError
from somrs.kernel.component import Answered, Effect, Input, Rang, Received, Record, Send, Started, Undelivered, Wake
from somrs.ontology.check import check
from somrs.ontology.conformance import Violation
from somrs.ontology.truth import bindings
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id, normalised_id, reply
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import (
    Alteration,
    Consider,
    Define,
    Defined,
    Event,
    MapChanged,
    MapSubscribed,
    OntologyChanged,
    QueryMap,
    ReadEvents,
    ReadHistory,
    ReadMap,
    ReadOntology,
    RenameObject,
    Row,
    Rows,
    SubscribeMap,
    Undo,
    Updated,
    UpdateMap,
)
from somrs.protocol.messages.leases import granted
from somrs.protocol.messages.paging import PAGE_BYTES, fitting, size
from somrs.repository.definition import object_renamed, redefined
from somrs.repository.entries import REMEMBERED, Answer, Contents, Defining, Handled, LeasesDue, PastOf, StoreWanted, Subscription
from somrs.repository.history_queries import LookingBack
from somrs.repository.outcome import VERSION, Outcome, considered, rejected
from somrs.repository.pages import MapPages, ontology_page
from somrs.repository.past import inverse
from somrs.repository.undoing import undone
from somrs.repository.update import updated
from somrs.repository.version_conflict import overtaken

MOST_ROWS = 1000
"""So many ways in which a formula holds are told at most."""


class Repository:
    """Owns `contents`: nobody else changes them."""

    def __init__(self, address: str, contents: Contents) -> None:
        self._address = address
        self._contents = contents
        self._pages = MapPages(contents.map)
        self._subscribed_at: dict[str, int] = dict.fromkeys(contents.subscriptions, contents.version)
        self._back = LookingBack(contents)

    @property
    def contents(self) -> Contents:
        return self._contents

    def handle(self, event: Input, now: float) -> list[Effect]:
        """What to do about the input."""
        match event:
            case Started():
                # Who followed the map before the Repository went down learns which version it is at, and reads what it missed.
                greetings = [self._tell(subscriber, self._subscribed(subscriber), now) for subscriber in self._contents.subscriptions]
                return [*greetings, self._next_expiry()]
            case Received(message):
                try:
                    return self._received(message, now)
                except InputError as error:
                    return [self._answer(message, Fault(code="Sender", text=str(error)))]
            case Rang(LeasesDue()):
                return self._expire(now)
            case Answered(StoreWanted(request), value):
                return self._answered(request, value, now)
            case Undelivered(message):
                return self._undelivered(message)
            case _:
                return []  # it sets no other timer, and asks nothing else

    def _received(self, message: Message, now: float) -> list[Effect]:
        match message.body:
            case ReadOntology() | ReadMap() as question:
                return self._read(message, question)
            case QueryMap() as query:
                return [self._answer(message, self._rows(query))]
            case UpdateMap() | Define() | RenameObject() as alteration:
                return self._once(message, lambda: self._alter(message, alteration, self._worked_out(alteration), now))
            case Undo() as undo:
                return self._once(message, lambda: self._back.ask(message, self._back.event(undo)))
            case Consider(change=Undo() as undo):
                return self._back.ask(message, self._back.event(undo))
            case Consider(change=UpdateMap() | Define() | RenameObject() as alteration):
                return [self._consider(message, alteration, self._worked_out(alteration))]
            case ReadHistory() as question:
                return self._back.ask(message, self._back.history(question))
            case ReadEvents() as question:
                return self._back.ask(message, self._back.events(question))
            case SubscribeMap(lease=lease):
                return self._subscribe(message, lease, now)
            case Fault():
                return []  # a Fault is never answered, least of all by a Fault
            case body:
                text = f"a Repository does not understand {type(body).__name__}; it reads, queries, updates and follows maps and ontologies"
                return [self._answer(message, Fault(code="ActionNotSupported", text=text))]

    def _answer(self, to: Message, body: object) -> Send:
        return Send(reply(to, body, self._address))  # type: ignore[arg-type]  # the callers pass bodies

    # Asking

    def _read(self, message: Message, question: ReadOntology | ReadMap) -> list[Effect]:
        contents = self._contents
        if question.at_version is not None:
            found = self._back.past(question, question.at_version)
            return self._back.ask(message, found) if isinstance(found, PastOf) else [self._answer(message, found)]
        if isinstance(question, ReadOntology):
            page = ontology_page(contents.ontology, contents.version, question.after, contents.ontology_changed_at)
            return [self._answer(message, page)]
        if self._pages.map is not contents.map:
            self._pages = MapPages(contents.map)
        return [self._answer(message, self._pages.page(contents.version, question.after))]

    def _rows(self, query: QueryMap) -> Rows:
        formula = check(query.formula, self._contents.ontology, self._contents.map)
        limit = min(max(query.limit, 0), MOST_ROWS)
        found = [
            Row(bindings={name: str(term) for name, term in row.items()})
            for row in islice(bindings(formula, self._contents.map, self._contents.ontology), limit + 1)
        ]
        rows = tuple(fitting(found, limit))
        return Rows(rows=rows, version=self._contents.version, more=len(rows) < len(found))

    def _answered(self, request: str, value: object, now: float) -> list[Effect]:
        """The store answered something."""
        message = self._back.answered(request)
        match message.body if message is not None else None:
            case Undo() as undo if message is not None and isinstance(value, tuple):
                return self._once(message, lambda: self._alter(message, undo, self._undone(undo, value), now))
            case Consider(change=Undo() as undo) if message is not None and isinstance(value, tuple):
                return [self._consider(message, undo, self._undone(undo, value))]
        return [self._answer(message, self._back.told(message, value))] if message is not None else []

    # Changing

    def _once(self, message: Message, work: Callable[[], list[Effect]]) -> list[Effect]:
        """Carry a request out, or answer it again if it was carried out."""
        answer = self._contents.answered.get(normalised_id(message.header.message_id))
        return work() if answer is None else [self._answer(message, answer)]

    def _worked_out(self, alteration: UpdateMap | Define | RenameObject) -> Outcome:
        map, ontology = self._contents.map, self._contents.ontology
        match alteration:
            case UpdateMap():
                return updated(map, ontology, alteration)
            case Define():
                return redefined(map, ontology, alteration)
            case RenameObject():
                return object_renamed(map, ontology, alteration)

    def _undone(self, undo: Undo, found: tuple[Event, ...]) -> Outcome:
        contents = self._contents
        if found and found[0].version == undo.version > contents.since:
            return undone(found[0], contents)
        message = f"there is no version {undo.version} that could be undone; the latest is {contents.version}"
        if 0 < undo.version <= contents.since:
            message = f"what was before version {undo.version} is not known any more; from version {contents.since + 1} on, it is"
        violation = Violation(subject=f"version {undo.version}", rule="unknown-version", message=message, section=VERSION)
        return Outcome(map=contents.map, ontology=contents.ontology, broken=(violation,))

    def _consider(self, message: Message, alteration: Alteration, outcome: Outcome) -> Send:
        return self._answer(message, considered(self._with_overtaken(alteration, outcome), self._contents.version))

    def _with_overtaken(self, alteration: Alteration, outcome: Outcome) -> Outcome:
        late = tuple(overtaken(alteration, outcome, self._contents))
        return replace(outcome, broken=(*late, *outcome.broken)) if late else outcome

    def _alter(self, message: Message, alteration: Alteration, outcome: Outcome, now: float) -> list[Effect]:
        """Make the change, unless rules would be broken or somebody was quicker."""
        contents = self._contents
        outcome = self._with_overtaken(alteration, outcome)
        if outcome.broken:
            return self._handled(message, rejected(outcome.broken, contents.version))
        done: type[Updated | Defined] = Defined if isinstance(alteration, Define) else Updated
        if not outcome.changes and outcome.revision is None:
            return self._handled(message, done(version=contents.version))
        event = Event(
            version=contents.version + 1,
            at=now,
            author=alteration.author or message.header.sender,
            changes=outcome.changes,
            revision=outcome.revision,
            renamed=outcome.renamed,
            undoes=alteration.version if isinstance(alteration, Undo) else None,
            before=inverse(contents.map, outcome.changes),
        )
        contents.version = event.version
        contents.map, contents.ontology = outcome.map, outcome.ontology
        contents.changed_at.update(dict.fromkeys(outcome.objects, event.version))
        contents.defined_at.update(dict.fromkeys(outcome.definitions, Defining(version=event.version, author=event.author)))
        effects = self._handled(message, done(version=event.version), event)
        news = outcome.told(event.version) if event.revision is not None else MapChanged(event=structs.replace(event, before=()))
        return effects + self._publish(news, now)

    def _handled(self, message: Message, answer: Answer, event: Event | None = None) -> list[Effect]:
        """Remember the answer, on disk too, then give it."""
        request = normalised_id(message.header.message_id)
        answered = self._contents.answered
        answered[request] = answer
        while len(answered) > REMEMBERED:
            del answered[next(iter(answered))]
        return [Record(Handled(request=request, answer=answer, event=event)), self._answer(message, answer)]

    # Following

    def _subscribe(self, message: Message, lease: float, now: float) -> list[Effect]:
        subscriber = message.header.sender
        if subscriber == ANONYMOUS:
            raise InputError("changes can only be sent to somebody who has an address: set the sender to one that can be reached")
        until = now + granted(lease)
        self._contents.subscriptions[subscriber] = until
        self._subscribed_at[subscriber] = self._contents.version
        return [
            Record(Subscription(address=subscriber, until=until)),
            self._answer(message, self._subscribed(subscriber)),
            self._next_expiry(),
        ]

    def _subscribed(self, subscriber: str) -> MapSubscribed:
        return MapSubscribed(version=self._contents.version, until=self._contents.subscriptions[subscriber])

    def _publish(self, news: MapChanged | OntologyChanged, now: float) -> list[Effect]:
        # What is too large for one message is read by pages: the version alone tells the subscriber that it missed something.
        large = size(news) > PAGE_BYTES * 1.25
        subscribers = [address for address, until in self._contents.subscriptions.items() if until > now]
        return [self._tell(address, self._subscribed(address) if large else news, now) for address in subscribers]

    def _tell(self, subscriber: str, news: MapChanged | OntologyChanged | MapSubscribed, now: float) -> Send:
        kind, version = type(news).__name__, self._contents.version
        identity = message_id(self._address, subscriber, kind, version, now if isinstance(news, MapSubscribed) else "")
        return Send(Message(header=Header(sender=self._address, recipient=subscriber, message_id=identity), body=news))

    def _undelivered(self, message: Message) -> list[Effect]:
        """A subscriber that cannot be reached is dropped, unless it subscribed again since the message was sent."""
        subscriber = message.header.recipient
        match message.body:
            case MapChanged(event=event):
                version = event.version
            case OntologyChanged(version=version) | MapSubscribed(version=version):
                pass
            case _:
                return []
        if subscriber not in self._contents.subscriptions or version <= self._subscribed_at.get(subscriber, 0):
            return []
        return self._drop([subscriber])

    def _expire(self, now: float) -> list[Effect]:
        return self._drop([address for address, until in self._contents.subscriptions.items() if until <= now])

    def _drop(self, subscribers: list[str]) -> list[Effect]:
        for subscriber in subscribers:
            del self._contents.subscriptions[subscriber]
            self._subscribed_at.pop(subscriber, None)
        return [*(Record(Subscription(address=subscriber, until=None)) for subscriber in subscribers), self._next_expiry()]

    def _next_expiry(self) -> Wake:
        return Wake(LeasesDue(), min(self._contents.subscriptions.values(), default=None))

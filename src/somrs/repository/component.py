"""The Repository: the common ontology and a map of the environment, for all who ask, change and follow them.

Paper, "Repository": a realisation of the common knowledge of the environment's representation, and a storage of its maps.
What an update comes to is `update.py`'s, how answers are cut into pages `pages.py`'s, what is on disk `entries.py`'s.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice

from msgspec import structs

from somrs.entish.parse import nearest
from somrs.errors import InputError
from somrs.ontology.check import check
from somrs.ontology.conformance import violations
from somrs.ontology.consistency import ontology_violations
from somrs.ontology.objects import objects_of
from somrs.ontology.truth import bindings
from somrs.protocol.component import Answered, Ask, Effect, Input, Rang, Received, Record, Send, Started, Undelivered, Wake
from somrs.protocol.envelope import ANONYMOUS, Header, Message, message_id, normalised_id, reply
from somrs.protocol.frp import Fault
from somrs.protocol.knowledge import (
    Define,
    Defined,
    Definitions,
    Event,
    History,
    MapChanged,
    MapSubscribed,
    OntologyChanged,
    QueryMap,
    ReadHistory,
    ReadMap,
    ReadOntology,
    Rejected,
    Row,
    Rows,
    SubscribeMap,
    Updated,
    UpdateMap,
    by_kind,
)
from somrs.protocol.leases import granted
from somrs.protocol.paging import PAGE_BYTES, fitting, size
from somrs.repository.entries import REMEMBERED, Answer, Contents, Handled, HistoryOf, Subscription
from somrs.repository.pages import MapPages, ontology_page
from somrs.repository.update import Outcome, is_name, outcome, rejected

LEASES = "leases"
"""The timer that rings when the next subscription runs out."""

MOST_ROWS = 1000
"""So many ways in which a formula holds are told at most."""


class Repository:
    """Owns `contents`: nobody else changes them."""

    def __init__(self, address: str, contents: Contents) -> None:
        self._address = address
        self._contents = contents
        self._pages = MapPages(contents.map)
        self._subscribed_at: dict[str, int] = dict.fromkeys(contents.subscriptions, contents.version)
        self._asked: dict[str, Message] = {}

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
            case Rang():
                return self._expire(now)
            case Answered(question, value):
                return self._history(question, value)
            case Undelivered(message):
                return self._undelivered(message)

    def _received(self, message: Message, now: float) -> list[Effect]:
        match message.body:
            case ReadOntology(after=after):
                return [self._answer(message, ontology_page(self._contents.ontology, self._contents.version, after))]
            case ReadMap(after=after):
                if self._pages.map is not self._contents.map:
                    self._pages = MapPages(self._contents.map)
                return [self._answer(message, self._pages.page(self._contents.version, after))]
            case QueryMap() as query:
                return [self._answer(message, self._rows(query))]
            case UpdateMap() as update:
                return self._once(message, lambda: self._update(message, update, now))
            case Define() as define:
                return self._once(message, lambda: self._define(message, define, now))
            case ReadHistory() as question:
                return self._ask(message, question)
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

    def _rows(self, query: QueryMap) -> Rows:
        formula = check(query.formula, self._contents.ontology, self._contents.map)
        limit = min(max(query.limit, 0), MOST_ROWS)
        found = [
            Row(bindings={name: str(term) for name, term in row.items()})
            for row in islice(bindings(formula, self._contents.map, self._contents.ontology), limit + 1)
        ]
        rows = tuple(fitting(found, limit))
        return Rows(rows=rows, version=self._contents.version, more=len(rows) < len(found))

    def _ask(self, message: Message, question: ReadHistory) -> list[Effect]:
        key = normalised_id(message.header.message_id)
        if key in self._asked:
            return []  # its answer is on the way
        self._asked[key] = message
        return [Ask(key, HistoryOf(object=question.object, limit=min(max(question.limit, 1), MOST_ROWS)))]

    def _history(self, question: str, value: object) -> list[Effect]:
        message = self._asked.pop(question, None)
        if message is None or not isinstance(message.body, ReadHistory):
            return []
        name = message.body.object
        if not isinstance(value, tuple):
            return [self._answer(message, Fault(code="Receiver", text=f"the history of {name} cannot be read: {value}"))]
        if not value and name not in self._contents.map.objects:
            hint = nearest(name, self._contents.map.objects)
            return [self._answer(message, Fault(code="Sender", text=f"there never was an object {name} on the map. {hint}".rstrip()))]
        return [self._answer(message, History(object=name, events=tuple(fitting(value, MOST_ROWS))))]

    # Changing

    def _once(self, message: Message, work: Callable[[], list[Effect]]) -> list[Effect]:
        """Carry a request out, or answer it again if it was carried out."""
        answer = self._contents.answered.get(normalised_id(message.header.message_id))
        return work() if answer is None else [self._answer(message, answer)]

    def _update(self, message: Message, update: UpdateMap, now: float) -> list[Effect]:
        contents = self._contents
        result = outcome(contents.map, contents.ontology, update)
        if isinstance(result, Outcome) and (problems := self._overtaken(result, update.expected_version)):
            result = rejected(problems)
        if isinstance(result, Rejected):
            return self._handled(message, structs.replace(result, version=contents.version))
        if not result.changes:
            return self._handled(message, Updated(version=contents.version))
        contents.version += 1
        contents.map = result.map
        contents.changed_at.update(dict.fromkeys(result.objects, contents.version))
        author = update.author or message.header.sender
        event = Event(version=contents.version, at=now, author=author, changes=result.changes)
        effects = self._handled(message, Updated(version=contents.version), event=event)
        return effects + self._publish(MapChanged(event=event), now)

    def _overtaken(self, result: Outcome, expected: int | None) -> list[str]:
        if expected is None:
            return []
        if expected > self._contents.version:
            return [f"version {expected} is still to come, the map's version is {self._contents.version}: read the map again"]
        # A fact says something of its first object: that a thing leaves a table is no news about the table.
        changed = {name: self._contents.changed_at.get(name, 0) for name in (objects_of(change)[0] for change in result.changes)}
        return [
            f"{name}: changed in version {version}, after version {expected} that was expected; read it again and decide anew"
            for name, version in changed.items()
            if version > expected
        ]

    def _define(self, message: Message, define: Define, now: float) -> list[Effect]:
        contents = self._contents
        known = list(contents.ontology)
        added = by_kind(definition for definition in define.definitions.each() if definition not in known)
        ontology = contents.ontology.extended(added.each())
        unusable = [f"{definition.name!r} is no name that formulas can use" for definition in added.each() if not is_name(definition.name)]
        if problems := unusable or ontology_violations(ontology) or violations(contents.map, ontology):
            return self._handled(message, rejected(str(problem) for problem in problems))
        if not any(added.each()):
            return self._handled(message, Defined(version=contents.version))
        contents.version += 1
        contents.ontology = ontology
        event = Event(version=contents.version, at=now, author=define.author or message.header.sender, changes=())
        effects = self._handled(message, Defined(version=contents.version), event=event, definitions=added)
        return effects + self._publish(OntologyChanged(definitions=added, version=contents.version), now)

    def _handled(
        self, message: Message, answer: Answer, *, event: Event | None = None, definitions: Definitions | None = None
    ) -> list[Effect]:
        """Remember the answer, on disk too, then give it."""
        request = normalised_id(message.header.message_id)
        answered = self._contents.answered
        answered[request] = answer
        while len(answered) > REMEMBERED:
            del answered[next(iter(answered))]
        return [Record(Handled(request=request, answer=answer, event=event, definitions=definitions)), self._answer(message, answer)]

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
        return Wake(LEASES, min(self._contents.subscriptions.values(), default=None))

"""Questions that the Repository's store has to answer: what happened, and how the map and the ontology were. They wait here for it."""

from __future__ import annotations

from somrs.entish.parse import nearest
from somrs.errors import InputError
from somrs.kernel.component import Ask, Effect
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Message, normalised_id
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import Event, Events, History, ReadEvents, ReadHistory, ReadMap, ReadOntology, Undo
from somrs.protocol.messages.paging import fitting
from somrs.repository.entries import Contents, EventsOf, HistoryOf, PastOf, StoreWanted
from somrs.repository.pages import MapPages, ontology_page
from somrs.repository.past import Past, shortened

MOST_EVENTS = 1000
"""On one page."""

KEPT = 4
"""So many versions of the past are kept, for the next pages of them."""


class LookingBack:
    """Owned by a Repository, which hands it the questions and the store's answers."""

    def __init__(self, contents: Contents) -> None:
        self._contents = contents
        self._asked: dict[str, Message] = {}
        self._pasts: dict[int, tuple[Past, MapPages]] = {}

    def ask(self, message: Message, task: object) -> list[Effect]:
        """Have the store answer something of the message; one that came again waits for the same answer."""
        key = normalised_id(message.header.message_id)
        if key in self._asked:
            return []
        self._asked[key] = message
        return [Ask(StoreWanted(key), task)]

    def answered(self, request: str) -> Message | None:
        """The message that asked; None for one that nobody asks any more."""
        return self._asked.pop(request, None)

    # Questions

    def history(self, question: ReadHistory) -> HistoryOf:
        return HistoryOf(object=question.object, limit=min(max(question.limit, 1), MOST_EVENTS))

    def events(self, question: ReadEvents) -> EventsOf:
        if question.before is not None and question.after is not None:
            raise InputError("events are told before a version or after one: give one of the two")
        limit = min(max(question.limit, 1), MOST_EVENTS)
        # One more than was asked for says that there are more.
        return EventsOf(limit=limit + 1, before=question.before, after=question.after, ontology=question.ontology, brief=question.brief)

    def event(self, undo: Undo) -> EventsOf:
        """The one event that is to be undone."""
        return EventsOf(limit=1, before=undo.version + 1)

    def past(self, question: ReadMap | ReadOntology, at: int) -> Body | PastOf:
        """The page of the past that is asked for, or what the store has to find out first."""
        contents = self._contents
        if not contents.since <= at <= contents.version:
            first = f", from version {contents.since} on" if contents.since else ""
            raise InputError(f"the map and the ontology are known up to version {contents.version}{first}; version {at} is none of these")
        if (known := self._pasts.get(at)) is None:
            return PastOf(at_version=at, version=contents.version, map=contents.map, ontology=contents.ontology)
        past, pages = known
        if isinstance(question, ReadMap):
            return pages.page(at, question.after)
        return ontology_page(past.ontology, at, question.after, past.changed_at)

    # Answers

    def told(self, message: Message, value: object) -> Body:
        """What the store's value says to whoever asked."""
        match message.body, value:
            case ReadHistory(object=name), tuple():
                return self._history(name, value)
            case ReadEvents(limit=limit), tuple():
                page = tuple(fitting(map(shortened, value), min(max(limit, 1), MOST_EVENTS)))
                return Events(events=page, more=len(page) < len(value), since=self._contents.since)
            case (ReadMap(at_version=int(at)) | ReadOntology(at_version=int(at))) as question, Past() as past:
                while len(self._pasts) >= KEPT:
                    del self._pasts[next(iter(self._pasts))]
                self._pasts[at] = past, MapPages(past.map)
                page_ = self.past(question, at)
                assert not isinstance(page_, PastOf), "it was just told"
                return page_
            case asked, _:
                what = f"the history of {asked.object}" if isinstance(asked, ReadHistory) else "what happened"
                return Fault(code="Receiver", text=f"{what} cannot be read: {value}")

    def _history(self, name: str, events: tuple[Event, ...]) -> Body:
        if not events and name not in self._contents.map.objects:
            hint = nearest(name, self._contents.map.objects)
            return Fault(code="Sender", text=f"there never was an object {name} on the map. {hint}".rstrip())
        return History(object=name, events=tuple(fitting(map(shortened, events), MOST_EVENTS)))

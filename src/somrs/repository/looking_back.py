"""Questions that the archive has to answer: what happened, and how the map and the ontology were."""

from __future__ import annotations

from somrs.entish.parse import nearest
from somrs.errors import InputError
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import (
    Event,
    Events,
    History,
    MapPage,
    OntologyPage,
    ReadEvents,
    ReadHistory,
    ReadMap,
    ReadOntology,
    Undo,
)
from somrs.protocol.messages.paging import fit_page
from somrs.repository.past import shortened
from somrs.repository.state import Contents, EventsOf, Happened, HistoryOf, PageOf

MOST_EVENTS = 1000
"""On one page."""


def history_wanted(question: ReadHistory) -> HistoryOf:
    return HistoryOf(object=question.object, limit=_limit(question.limit))


def events_wanted(question: ReadEvents) -> EventsOf:
    """Raises InputError for a question about two directions at once."""
    if question.before is not None and question.after is not None:
        raise InputError("events are told before a version or after one: give one of the two")
    # One more than was asked for says that there are more.
    limit = _limit(question.limit) + 1
    return EventsOf(limit=limit, before=question.before, after=question.after, ontology=question.ontology, brief=question.brief)


def undone_wanted(undo: Undo) -> EventsOf:
    """The one event that is to be undone."""
    return EventsOf(limit=1, before=undo.version + 1)


def page_wanted(question: ReadMap | ReadOntology, at: int, contents: Contents) -> PageOf:
    """The page of the past that is asked for. Raises InputError for a version that is not known."""
    if not contents.since <= at <= contents.version:
        first = f", from version {contents.since} on" if contents.since else ""
        raise InputError(f"the map and the ontology are known up to version {contents.version}{first}; version {at} is none of these")
    return PageOf(question=question, at_version=at, version=contents.version, map=contents.map, ontology=contents.ontology)


def told(message: Message, value: object, contents: Contents) -> Body:
    """What the archive's answer says to whoever asked."""
    match message.body, value:
        case ReadHistory(object=name), Happened(events):
            return _history(name, events, contents)
        case ReadEvents(limit=limit), Happened(events):
            page = tuple(fit_page(map(shortened, events), _limit(limit)))
            return Events(events=page, more=len(page) < len(events), since=contents.since)
        case ReadMap() | ReadOntology(), MapPage() | OntologyPage() as page_:
            return page_
        case asked, _:
            what = f"the history of {asked.object}" if isinstance(asked, ReadHistory) else "what happened"
            return Fault(code="Receiver", text=f"{what} cannot be read: {value}")


def _limit(wanted: int) -> int:
    return min(max(wanted, 1), MOST_EVENTS)


def _history(name: str, events: tuple[Event, ...], contents: Contents) -> Body:
    if not events and name not in contents.map.objects:
        hint = nearest(name, contents.map.objects)
        return Fault(code="Sender", text=f"there never was an object {name} on the map. {hint}".rstrip())
    return History(object=name, events=tuple(fit_page(map(shortened, events), MOST_EVENTS)))

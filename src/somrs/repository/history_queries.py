"""Queries that the archive answers: past events, and past versions of the map and the ontology."""

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
    QueryMap,
    ReadEvents,
    ReadHistory,
    ReadMap,
    ReadOntology,
    Rows,
    Undo,
)
from somrs.protocol.messages.paging import fit_page
from somrs.repository.rollback import shorten_event
from somrs.repository.state import ArchivedEvents, Contents, EventsOf, HistoryOf, PageOf

MAX_EVENTS = 1000
"""The maximum number of events on a page."""


def history_query(question: ReadHistory) -> HistoryOf:
    # One event more than requested shows that there are more.
    return HistoryOf(object=question.object, limit=_limit(question.limit) + 1, before=question.before)


def events_query(question: ReadEvents) -> EventsOf:
    """The archive's task for ReadEvents. Raises InputError if both `before` and `after` are given."""
    if question.before is not None and question.after is not None:
        raise InputError("events are read either before a version or after one: give one of the two")
    # One event more than requested shows that there are more.
    limit = _limit(question.limit) + 1
    return EventsOf(limit=limit, before=question.before, after=question.after, ontology=question.ontology, brief=question.brief)


def undo_query(undo: Undo) -> EventsOf:
    """The archive's task for the event to undo."""
    return EventsOf(limit=1, before=undo.version + 1)


def page_query(question: ReadMap | ReadOntology, at_version: int, contents: Contents) -> PageOf:
    """The archive's task for a page of a past version. Raises InputError for a version that is not stored."""
    if not contents.since <= at_version <= contents.version:
        first = f", from version {contents.since} on" if contents.since else ""
        raise InputError(
            f"the map and the ontology are known up to version {contents.version}{first}; version {at_version} is none of these"
        )
    return PageOf(question=question, at_version=at_version, version=contents.version, map=contents.map, ontology=contents.ontology)


def archive_reply(message: Message, value: object, contents: Contents) -> Body:
    """The reply to a request from the archive's answer."""
    match message.body, value:
        case ReadHistory() as question, ArchivedEvents(events):
            return _history(question, events, contents)
        case ReadEvents(limit=limit), ArchivedEvents(events):
            page = tuple(fit_page(map(shorten_event, events), _limit(limit)))
            return Events(events=page, more=len(page) < len(events), since=contents.since)
        case ReadMap() | ReadOntology(), MapPage() | OntologyPage() as page_:
            return page_
        case QueryMap(), Rows() as rows:
            return rows
        case QueryMap(), _:
            return Fault(code="Sender" if isinstance(value, InputError) else "Receiver", text=str(value))
        case question, _:
            subject = f"the history of {question.object}" if isinstance(question, ReadHistory) else "the archive"
            return Fault(code="Receiver", text=f"{subject} cannot be read: {value}")


def _limit(limit: int) -> int:
    return min(max(limit, 1), MAX_EVENTS)


def _history(question: ReadHistory, events: tuple[Event, ...], contents: Contents) -> Body:
    name = question.object
    if not events and question.before is None and name not in contents.map.objects:
        hint = nearest(name, contents.map.similar_names(name))
        return Fault(code="Sender", text=f"there never was an object {name} on the map. {hint}".rstrip())
    page = tuple(fit_page(map(shorten_event, events), _limit(question.limit)))
    return History(object=name, events=page, more=len(page) < len(events), discovered=contents.provenance.discoveries.get(name))

"""Read the events in a Repository's file, and the changes that lead back to an earlier version. `repository_store.py` has the tables."""

from __future__ import annotations

import functools
import sqlite3
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import msgspec

from somrs.ontology.naming import Renaming
from somrs.ontology.objects import Change
from somrs.protocol.messages.knowledge import Event, Merging, Revision
from somrs.protocol.messages.observations import Reception
from somrs.repository.outcome import revert_revision
from somrs.repository.rollback import PastState, rewind_map
from somrs.repository.state import EventsOf, HistoryOf, PageOf
from somrs.storage.disk import Job

_CHANGES = msgspec.json.Decoder(tuple[Change, ...])
_REVISION = msgspec.json.Decoder(Revision)
_RENAMED = msgspec.json.Decoder(tuple[Renaming, ...])
_MERGED = msgspec.json.Decoder(tuple[Merging, ...])
_RECEPTION = msgspec.json.Decoder(Reception)

_COLUMNS = "events.version, at, author, changes, before, revision, renamed, undoes, NULL, reception, merged"
_BRIEF = "version, at, author, '[]', '[]', iif(revision IS NULL, NULL, '{}'), renamed, undoes, json_array_length(changes), NULL, merged"


_LATEST = 1 << 62
"""A number above all versions."""


class Row(NamedTuple):
    """An event as a row of the file."""

    version: int
    at: float
    author: str
    changes: str
    before: str | None
    revision: str | None
    renamed: str | None
    undoes: int | None
    all_changes: int | None
    reception: str | None
    merged: str | None


def event_of(row: Row) -> Event:
    return Event(
        version=row.version,
        at=row.at,
        author=row.author,
        changes=_CHANGES.decode(row.changes),
        before=_CHANGES.decode(row.before) if row.before is not None else (),
        revision=_REVISION.decode(row.revision) if row.revision is not None else None,
        renamed=_RENAMED.decode(row.renamed) if row.renamed is not None else (),
        undoes=row.undoes,
        all_changes=row.all_changes,
        reception=_RECEPTION.decode(row.reception) if row.reception is not None else None,
        merged=_MERGED.decode(row.merged) if row.merged is not None else (),
    )


def read_job(task: HistoryOf | EventsOf) -> Job[list[Row]]:
    """Return the job that reads the requested events."""
    match task:
        case HistoryOf():
            return functools.partial(_history, task)
        case EventsOf():
            return functools.partial(_read_events, task)


def _read_events(query: EventsOf, db: sqlite3.Connection) -> list[Row]:
    """Return the requested events."""
    condition, order = ("version > ?", "ASC") if query.after is not None else ("version < ?", "DESC")
    bound = query.after if query.after is not None else query.before if query.before is not None else _LATEST
    if query.ontology:
        condition += " AND revision IS NOT NULL"
    columns = _BRIEF if query.brief else _COLUMNS
    rows = db.execute(f"SELECT {columns} FROM events WHERE {condition} ORDER BY version {order} LIMIT ?", (bound, query.limit))
    return [Row(*row) for row in rows]


def read_event(version: int, db: sqlite3.Connection) -> Row | None:
    """Return the event that led to the version, if it is stored."""
    row = db.execute(f"SELECT {_COLUMNS} FROM events WHERE version = ?", (version,)).fetchone()
    return Row(*row) if row is not None else None


class _Span(NamedTuple):
    """The versions from `first` to `last` in which an object had a name."""

    name: str
    first: int
    last: int


def _history(query: HistoryOf, db: sqlite3.Connection) -> list[Row]:
    """Return the latest events that changed the object, newest first, under all names that it had."""
    latest = query.before - 1 if query.before is not None else _LATEST
    # Each name by itself: SQLite then reads only the latest versions of each from the index.
    versions: set[int] = set()
    for span in _name_spans(query.object, _LATEST, db):
        bounds = (span.name, span.first, min(span.last, latest), query.limit)
        touched = "SELECT version FROM touched WHERE object = ? AND version BETWEEN ? AND ? ORDER BY version DESC LIMIT ?"
        versions.update(version for (version,) in db.execute(touched, bounds))
    rows = (read_event(version, db) for version in sorted(versions, reverse=True)[: query.limit])
    return [row for row in rows if row is not None]


def _name_spans(name: str, last: int, db: sqlite3.Connection) -> Iterator[_Span]:
    """Return when an object had which name, up to the version `last`: its own names, and those of objects that turned out to be it."""
    # The object got this name in this version; an earlier object of the same name was another one.
    renaming = db.execute(
        "SELECT version, before FROM renamed WHERE name = ? AND version <= ? ORDER BY version DESC", (name, last)
    ).fetchone()
    first, old_name = renaming if renaming is not None else (0, None)
    yield _Span(name, first, last)
    merged = db.execute("SELECT before, version FROM merged WHERE name = ? AND version BETWEEN ? AND ?", (name, first, last)).fetchall()
    for other_name, version in merged:
        yield from _name_spans(other_name, version - 1, db)
    if old_name is not None:
        yield from _name_spans(old_name, first - 1, db)


class Way(NamedTuple):
    """The changes that revert one event."""

    before: str
    revision: str | None


def read_way_back(version: int, earlier_version: int, db: sqlite3.Connection) -> tuple[list[Way], int]:
    """Return the changes that lead from a version back to an earlier one, the latest first.

    Also return the version of the last change of the ontology up to the earlier version.
    """
    rows = db.execute(
        "SELECT before, revision FROM events WHERE version > ? AND version <= ? ORDER BY version DESC", (earlier_version, version)
    )
    way = [Way(*row) for row in rows]
    (changed,) = db.execute(
        "SELECT coalesce(max(version), 0) FROM events WHERE revision IS NOT NULL AND version <= ?", (earlier_version,)
    ).fetchone()
    return way, changed


def restore_past(page_request: PageOf, way: Sequence[Way], changed_at: int) -> PastState:
    """Return the map and the ontology of the earlier version."""
    ontology = page_request.ontology
    for step in way:
        if step.revision is not None:
            ontology = revert_revision(ontology, _REVISION.decode(step.revision))
    map = rewind_map(page_request.map, (_CHANGES.decode(step.before) for step in way if step.before != "[]"))
    return PastState(map=map, ontology=ontology, changed_at=changed_at)

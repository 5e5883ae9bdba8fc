"""Read the events in a Repository's file, and the changes that lead back to an earlier version. `repository_store.py` has the tables."""

from __future__ import annotations

import functools
import sqlite3
from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from somrs.ontology.naming import Renaming
from somrs.ontology.objects import Change
from somrs.protocol.messages.knowledge import Event, Revision
from somrs.protocol.messages.observations import Reception
from somrs.repository.outcome import revert_revision
from somrs.repository.rollback import PastState, rewind_map
from somrs.repository.state import EventsOf, HistoryOf, PageOf
from somrs.storage.disk import Job

_CHANGES = msgspec.json.Decoder(tuple[Change, ...])
_REVISION = msgspec.json.Decoder(Revision)
_RENAMED = msgspec.json.Decoder(tuple[Renaming, ...])

_RECEPTION = msgspec.json.Decoder(Reception)

_COLUMNS = "events.version, at, author, changes, before, revision, renamed, undoes, NULL, reception"
_BRIEF = "version, at, author, '[]', '[]', iif(revision IS NULL, NULL, '{}'), renamed, undoes, json_array_length(changes), NULL"


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
    )


def read_job(task: HistoryOf | EventsOf) -> Job[list[Row]]:
    """Return the job that reads the requested events."""
    match task:
        case HistoryOf(object=object, limit=limit):
            return functools.partial(_history, object, limit)
        case EventsOf():
            return functools.partial(_read_events, task)


def _read_events(query: EventsOf, db: sqlite3.Connection) -> list[Row]:
    """Return the requested events."""
    condition, order = ("version > ?", "ASC") if query.after is not None else ("version < ?", "DESC")
    bound = query.after if query.after is not None else query.before if query.before is not None else 1 << 62
    if query.ontology:
        condition += " AND revision IS NOT NULL"
    columns = _BRIEF if query.brief else _COLUMNS
    rows = db.execute(f"SELECT {columns} FROM events WHERE {condition} ORDER BY version {order} LIMIT ?", (bound, query.limit))
    return [Row(*row) for row in rows]


def read_event(version: int, db: sqlite3.Connection) -> Row | None:
    """Return the event that led to the version, if it is stored."""
    row = db.execute(f"SELECT {_COLUMNS} FROM events WHERE version = ?", (version,)).fetchone()
    return Row(*row) if row is not None else None


def _history(object: str, limit: int, db: sqlite3.Connection) -> list[Row]:
    """Return the latest events that changed the object, newest first, under all names that it had."""
    found_rows: list[Row] = []
    name, last_version = object, 1 << 62
    while len(found_rows) < limit:
        # The object got this name in this version; an earlier object of the same name was another one.
        renaming_row = db.execute(
            "SELECT version, before FROM renamed WHERE name = ? AND version <= ? ORDER BY version DESC", (name, last_version)
        ).fetchone()
        first, old_name = renaming_row if renaming_row is not None else (0, None)
        rows = db.execute(
            f"SELECT {_COLUMNS} FROM events JOIN touched USING (version) WHERE object = ? AND version BETWEEN ? AND ?"
            " ORDER BY touched.version DESC LIMIT ?",
            (name, first, last_version, limit - len(found_rows)),
        )
        found_rows += [Row(*row) for row in rows]
        if old_name is None:
            break
        name, last_version = old_name, first - 1
    return found_rows


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

"""The events in a Repository's file: what happened, read back, and the way back through them. The tables are `repository_store.py`'s."""

from __future__ import annotations

import functools
import sqlite3
from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from somrs.ontology.naming import Renaming
from somrs.ontology.objects import Change
from somrs.protocol.messages.knowledge import Event, Revision
from somrs.repository.outcome import revert_revision
from somrs.repository.past import PastState, rewind_map
from somrs.repository.state import EventsOf, HistoryOf, PageOf
from somrs.storage.disk import Job

_CHANGES = msgspec.json.Decoder(tuple[Change, ...])
_REVISION = msgspec.json.Decoder(Revision)
_RENAMED = msgspec.json.Decoder(tuple[Renaming, ...])

_COLUMNS = "events.version, at, author, changes, before, revision, renamed, undoes, NULL"
_BRIEF = "version, at, author, '[]', '[]', iif(revision IS NULL, NULL, '{}'), renamed, undoes, json_array_length(changes)"


class Row(NamedTuple):
    """An event as it is in the file."""

    version: int
    at: float
    author: str
    changes: str
    before: str | None
    revision: str | None
    renamed: str | None
    undoes: int | None
    all_changes: int | None


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
    )


def reading(task: HistoryOf | EventsOf) -> Job[list[Row]]:
    """What reads the events that are asked for."""
    match task:
        case HistoryOf(object=object, limit=limit):
            return functools.partial(history, object, limit)
        case EventsOf():
            return functools.partial(happened, task)


def happened(wanted: EventsOf, db: sqlite3.Connection) -> list[Row]:
    """The events that are asked for."""
    where, order = ("version > ?", "ASC") if wanted.after is not None else ("version < ?", "DESC")
    bound = wanted.after if wanted.after is not None else wanted.before if wanted.before is not None else 1 << 62
    if wanted.ontology:
        where += " AND revision IS NOT NULL"
    columns = _BRIEF if wanted.brief else _COLUMNS
    rows = db.execute(f"SELECT {columns} FROM events WHERE {where} ORDER BY version {order} LIMIT ?", (bound, wanted.limit))
    return [Row(*row) for row in rows]


def happened_at(version: int, db: sqlite3.Connection) -> Row | None:
    """The event that led to the version, if it is known."""
    row = db.execute(f"SELECT {_COLUMNS} FROM events WHERE version = ?", (version,)).fetchone()
    return Row(*row) if row is not None else None


def history(object: str, limit: int, db: sqlite3.Connection) -> list[Row]:
    """The latest events that changed the object, newest first, under whatever name it had."""
    found: list[Row] = []
    name, last = object, 1 << 62
    while len(found) < limit:
        # The name was given to it in this version; what had the same name before was something else.
        given = db.execute(
            "SELECT version, before FROM renamed WHERE name = ? AND version <= ? ORDER BY version DESC", (name, last)
        ).fetchone()
        first, before = given if given is not None else (0, None)
        rows = db.execute(
            f"SELECT {_COLUMNS} FROM events JOIN touched USING (version) WHERE object = ? AND version BETWEEN ? AND ?"
            " ORDER BY touched.version DESC LIMIT ?",
            (name, first, last, limit - len(found)),
        )
        found += [Row(*row) for row in rows]
        if before is None:
            break
        name, last = before, first - 1
    return found


class Way(NamedTuple):
    """What leads back from one event."""

    before: str
    revision: str | None


def leading_back(version: int, at: int, db: sqlite3.Connection) -> tuple[list[Way], int]:
    """What leads from a version back to an earlier one, the latest event first; and the version in which the ontology changed last
    before that."""
    rows = db.execute("SELECT before, revision FROM events WHERE version > ? AND version <= ? ORDER BY version DESC", (at, version))
    way = [Way(*row) for row in rows]
    (changed,) = db.execute("SELECT coalesce(max(version), 0) FROM events WHERE revision IS NOT NULL AND version <= ?", (at,)).fetchone()
    return way, changed


def past(asked: PageOf, way: Sequence[Way], changed_at: int) -> PastState:
    """The map and the ontology at the other end of the way."""
    ontology = asked.ontology
    for step in way:
        if step.revision is not None:
            ontology = revert_revision(ontology, _REVISION.decode(step.revision))
    map = rewind_map(asked.map, (_CHANGES.decode(step.before) for step in way if step.before != "[]"))
    return PastState(map=map, ontology=ontology, changed_at=changed_at)
